"""What the operating system knows of this process."""

import sys

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
