"""Certificates and access rules for a site: who may publish, ask and see. Needs the extra ``secure``.

certificates   makes and reads certificates
access         the rules, as Zenoh takes them
folder         the folder that holds a site's authority, its members, and what each of them is given
validity       what is wrong with the certificates that a settings file names, or soon will be
"""
