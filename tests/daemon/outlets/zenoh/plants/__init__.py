"""Two plants and headquarters in network namespaces: Zenoh routers with TLS, cells behind NAT, lines that are cut.

Every process is a real one: routers of the configuration that docs/plants.md describes, cells with the Zenoh outlet and
a record on disk, consumers with ``Subscriber``. Needs root, ``ip`` and ``nft``.
"""
