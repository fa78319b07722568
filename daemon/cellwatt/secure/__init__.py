"""Certificates and access rules of a site: who may publish, ask and see. Needs the extra ``secure``.

certificates   makes and reads certificates
access         makes the rules in Zenoh's form
folder         keeps a site's authority, its members, and the files of each of them
validity       warns of certificates in a settings file that are missing, wrong or about to expire
"""
