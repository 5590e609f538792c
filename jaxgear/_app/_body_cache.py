"""The command `cache`: what is kept of condensed bodies, and how to be rid of it."""

import time
from collections.abc import Mapping
from typing import Any

from fem_prep._cache import cache_folder, clear, entries
from jaxgear._app._body_view import clear_views


def cache_summary() -> dict[str, Any]:
    """The bodies in the cache, the last used first."""
    return {
        "folder": str(cache_folder()),
        "bodies": [
            {
                "name": entry.name,
                "size_MB": entry.size / 1e6,
                "last_used": time.strftime("%Y-%m-%d %H:%M", time.localtime(entry.used)),
                "key": entry.key,
            }
            for entry in entries()
        ],
    }


def cleared() -> dict[str, Any]:
    """Remove all bodies, and say what that has freed."""
    return {"folder": str(cache_folder()), "freed_bytes": clear() + clear_views()}


def print_cache(found: Mapping[str, Any]) -> None:
    """Print what the cache holds, or what was removed, for a reader."""
    print(f"condensed bodies in {found['folder']}")
    if "freed_bytes" in found:
        print(f"freed {found['freed_bytes']:,} bytes")
        return
    if not found["bodies"]:
        print("none")
        return
    form = "{:<28} {:>10}  {:<16}  {}"
    print(form.format("name", "size", "last used", "key"))
    for row in found["bodies"]:
        name = row["name"] or "(unreadable)"
        print(form.format(name, f"{row['size_MB']:.1f} MB", row["last_used"], row["key"][:16]))
    total = sum(row["size_MB"] for row in found["bodies"])
    print(f"{len(found['bodies'])} in all, {total:.1f} MB; `jaxgear cache --clear` removes them")
