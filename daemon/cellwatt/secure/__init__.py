"""Access rules of a site: who may publish, ask and see. Needs the extra ``secure``.

access   makes the rules in Zenoh's format
folder   stores a site's authority, its members, and the files of each member
"""
