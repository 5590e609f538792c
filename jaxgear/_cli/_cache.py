"""The command `cache`: what is kept on this computer, and how to be rid of it."""

import time
from collections.abc import Mapping
from typing import Any

from fem_prep import cache_entries, cache_folder, clear_cache
from jaxgear._program_cache import clear_programs, kept_programs, programs_folder
from jaxgear.scene._body_view import clear_views


def cache_summary() -> dict[str, Any]:
    """The bodies and the compiled programs in the cache, the last used first."""
    return {
        "folder": _told(cache_folder()),
        "bodies": [
            {
                "name": entry.name,
                "size_MB": entry.size / 1e6,
                "last_used": _date(entry.used),
                "key": entry.key,
            }
            for entry in cache_entries()
        ],
        "programs_folder": _told(programs_folder()),
        "programs": [
            {
                "name": row.folder.name,
                "count": row.count,
                "size_MB": row.size / 1e6,
                "last_used": _date(row.used),
                "last_run": {"asked": row.asked, "found": row.found},
            }
            for row in kept_programs()
        ],
    }


def cleared() -> dict[str, Any]:
    """Remove all bodies and compiled programs, and say what that has freed."""
    bodies, programs = clear_cache() + clear_views(), clear_programs()
    return {
        "folder": _told(cache_folder()),
        "programs_folder": _told(programs_folder()),
        "freed_bytes": bodies + programs,
        "freed_by_bodies_bytes": bodies,
        "freed_by_programs_bytes": programs,
    }


def print_cache(found: Mapping[str, Any]) -> None:
    """Print what the cache holds, or what was removed, for a reader."""
    if found["folder"] is None:
        print("JAXGEAR_CACHE=off: nothing is kept")
        return
    print(f"condensed bodies in {found['folder']}")
    if "freed_bytes" in found:
        print(f"freed {found['freed_by_bodies_bytes']:,} bytes")
    else:
        _print_bodies(found["bodies"])
    print(f"compiled programs in {found['programs_folder']}")
    if "freed_bytes" in found:
        print(f"freed {found['freed_by_programs_bytes']:,} bytes")
    else:
        _print_programs(found["programs"])
    if found.get("bodies") or found.get("programs"):
        print("`jaxgear cache --clear` removes them")


def _print_bodies(rows: list[Mapping[str, Any]]) -> None:
    if not rows:
        print("none")
        return
    form = "{:<28} {:>10}  {:<16}  {}"
    print(form.format("name", "size", "last used", "key"))
    for row in rows:
        name = row["name"] or "(unreadable)"
        print(form.format(name, f"{row['size_MB']:.1f} MB", row["last_used"], row["key"][:16]))
    print(f"{len(rows)} in all, {sum(row['size_MB'] for row in rows):.1f} MB")


def _print_programs(rows: list[Mapping[str, Any]]) -> None:
    if not rows:
        print("none")
        return
    form = "{:<48} {:>8} {:>10}  {:<16}  {}"
    print(form.format("for", "number", "size", "last used", "of the last run"))
    for row in rows:
        last = row["last_run"]
        words = f"{last['found']} of {last['asked']}" if last["asked"] else ""
        size = f"{row['size_MB']:.1f} MB"
        print(form.format(row["name"], row["count"], size, row["last_used"], words))


def _told(folder: object) -> str | None:
    return None if folder is None else str(folder)


def _date(used: float) -> str:
    return time.strftime("%Y-%m-%d %H:%M", time.localtime(used))
