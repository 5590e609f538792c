"""The command `cache`: what is kept on this computer, and how to be rid of it."""

import time
from collections.abc import Mapping
from typing import Any, NamedTuple

from fem_prep import cache_entries, cache_folder, clear_cache
from jaxgear._program_cache import clear_programs, kept_programs, programs_folder
from jaxgear.scene._body_view import clear_views


class Cache(NamedTuple):
    """What is kept, a row each, and where; no folders where nothing is."""

    folder: str | None
    bodies: list[Mapping[str, Any]]
    programs_folder: str | None
    programs: list[Mapping[str, Any]]


class Freed(NamedTuple):
    """What the removal of what was kept has freed, and where."""

    folder: str | None
    programs_folder: str | None
    freed_bytes: int
    freed_by_bodies_bytes: int
    freed_by_programs_bytes: int


def cache_summary() -> Cache:
    """The bodies and the compiled programs in the cache, the last used first."""
    return Cache(
        folder=_told(cache_folder()),
        bodies=[
            {
                "name": entry.name,
                "size_MB": entry.size / 1e6,
                "last_used": _date(entry.used),
                "key": entry.key,
            }
            for entry in cache_entries()
        ],
        programs_folder=_told(programs_folder()),
        programs=[
            {
                "name": row.folder.name,
                "count": row.count,
                "size_MB": row.size / 1e6,
                "last_used": _date(row.used),
                "last_run": {"asked": row.asked, "found": row.found},
            }
            for row in kept_programs()
        ],
    )


def cleared() -> Freed:
    """Remove all bodies and compiled programs, and say what that has freed."""
    bodies, programs = clear_cache() + clear_views(), clear_programs()
    folders = _told(cache_folder()), _told(programs_folder())
    return Freed(*folders, bodies + programs, bodies, programs)


def print_cache(found: Cache | Freed) -> None:
    """Print what the cache holds, or what was removed, for a reader."""
    if found.folder is None:
        print("JAXGEAR_CACHE=off: nothing is kept")
        return
    if isinstance(found, Freed):
        bodies = [f"freed {found.freed_by_bodies_bytes:,} bytes"]
        programs = [f"freed {found.freed_by_programs_bytes:,} bytes"]
    else:
        bodies = _bodies(found.bodies) if found.bodies else ["none"]
        programs = _programs(found.programs) if found.programs else ["none"]
    print("\n".join([f"condensed bodies in {found.folder}", *bodies]))
    print("\n".join([f"compiled programs in {found.programs_folder}", *programs]))
    if isinstance(found, Cache) and (found.bodies or found.programs):
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
