"""Access rules of a site: who may publish, ask and see. Needs the extra ``secure``.

access   makes the rules in Zenoh's form
folder   keeps a site's authority, its members, and the files of each of them
"""
