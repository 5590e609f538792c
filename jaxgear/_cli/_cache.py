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
    for kind, words, folder, lines in (
        ("bodies", "condensed bodies", found["folder"], _bodies),
        ("programs", "compiled programs", found["programs_folder"], _programs),
    ):
        print(f"{words} in {folder}")
        if "freed_bytes" in found:
            print(f"freed {found[f'freed_by_{kind}_bytes']:,} bytes")
        else:
            print("\n".join(lines(found[kind]) if found[kind] else ["none"]))
    if found.get("bodies") or found.get("programs"):
        print("`jaxgear cache --clear` removes them")


def _bodies(rows: list[Mapping[str, Any]]) -> list[str]:
    form = "{:<28} {:>10}  {:<16}  {}"
    lines = [form.format("name", "size", "last used", "key")]
    for row in rows:
        name, size = row["name"] or "(unreadable)", f"{row['size_MB']:.1f} MB"
        lines.append(form.format(name, size, row["last_used"], row["key"][:16]))
    return [*lines, f"{len(rows)} in all, {sum(row['size_MB'] for row in rows):.1f} MB"]


def _programs(rows: list[Mapping[str, Any]]) -> list[str]:
    form = "{:<48} {:>8} {:>10}  {:<16}  {}"
    lines = [form.format("for", "number", "size", "last used", "of the last run")]
    for row in rows:
        last, size = row["last_run"], f"{row['size_MB']:.1f} MB"
        words = f"{last['found']} of {last['asked']}" if last["asked"] else ""
        lines.append(form.format(row["name"], row["count"], size, row["last_used"], words))
    return lines


def _told(folder: object) -> str | None:
    return None if folder is None else str(folder)


def _date(used: float) -> str:
    return time.strftime("%Y-%m-%d %H:%M", time.localtime(used))
