"""What the operating system knows of this process."""

import math
import sys
from pathlib import Path

try:
    import resource
except ImportError:  # Windows
    resource = None


def peak_memory() -> float:
    """The most memory that this process has had [MB]; not a number where that is not known."""
    if resource is None:
        return float("nan")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1024.0**2 if sys.platform == "darwin" else 1024.0)


def memory_maps() -> int:
    """How many pieces of memory Linux maps for this process; zero where nobody counts them."""
    try:
        return Path("/proc/self/maps").read_bytes().count(b"\n")
    except OSError:
        return 0


def most_memory_maps() -> float:
    """How many it may map; no limit where none is known."""
    try:
        return float(Path("/proc/sys/vm/max_map_count").read_text(encoding="ascii"))
    except (OSError, ValueError):
        return math.inf
