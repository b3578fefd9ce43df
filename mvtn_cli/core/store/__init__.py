"""The artifact directory: what was worked out once, under an address made of everything it depends on."""

from mvtn_cli.core.store.store import KINDS, KindSize, Store, cache_root, digest, file_stamp
from mvtn_cli.core.store.stored_shape import StoredShape

__all__ = ["KINDS", "KindSize", "Store", "StoredShape", "cache_root", "digest", "file_stamp"]
