"""`mvtn cache`: what lies in the artifact directory."""

from __future__ import annotations

from mvtn_cli.commands.options import Call
from mvtn_cli.config import CacheConfig
from mvtn_cli.console import counted
from mvtn_cli.errors import UsageError


def cache(config: CacheConfig, call: Call) -> None:
    """Show how much is stored, or clear it. Runs are your work and are never touched.

    Example: mvtn cache clear --kind shapes --yes
    """
    from mvtn_cli.core.store import Store, cache_root

    store = Store(cache_root(config.cache))
    sizes = {kind: size for kind, size in store.sizes().items() if config.kind in (None, kind)}
    if config.action == "clear":
        if not config.yes:
            total = size_words(sum(size.bytes for size in sizes.values()))
            raise UsageError(
                f"this would delete {total} from {store.root}",
                hint="add --yes to do it",
                code="cache.not-sure",
            )
        sizes = store.clear(config.kind or "all")
    total_files, total_bytes = (sum(column) for column in zip(*sizes.values(), strict=True))
    rows = [(kind, size.files, size_words(size.bytes)) for kind, size in sizes.items()]
    call.console.table(f"{store.root}", ["kind", "files", "size"], rows, stream="out")
    call.console.result(
        {
            "schema": "mvtn.cache/1",
            "action": config.action,
            "root": store.root,
            "kinds": {kind: {"files": size.files, "bytes": size.bytes} for kind, size in sizes.items()},
            "files": total_files,
            "bytes": total_bytes,
        }
    )
    verb = "deleted" if config.action == "clear" else "stored"
    call.console.note(f"{counted(total_files, 'file')}, {size_words(total_bytes)} {verb} in {store.root}")


def size_words(count: int) -> str:
    """Say a number of bytes: `512 B`, `1.5 MB`."""
    size, unit = float(count), "B"
    for unit in ("B", "kB", "MB", "GB", "TB"):
        if size < 1000 or unit == "TB":
            break
        size /= 1000
    return f"{size:.0f} {unit}" if unit == "B" else f"{size:.1f} {unit}"
