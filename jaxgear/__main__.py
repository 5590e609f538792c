"""The command `jaxgear`, and `python -m jaxgear`."""

import gc
import sys


def main() -> int:
    """Run the command line; an interruption is one line, even while it is being imported."""
    try:
        from jaxgear._cli import _main as _cli

        code = _cli.main()
        # At its end Python would look for garbage in all of it once more, for half a second.
        gc.freeze()
        return code
    except KeyboardInterrupt:
        print("jaxgear: interrupted", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
