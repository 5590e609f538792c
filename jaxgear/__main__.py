"""The command `jaxgear`, and `python -m jaxgear`."""

import sys


def main() -> int:
    """Run the command line; an interruption is one line, even while it is being imported."""
    try:
        from jaxgear._cli import _main as _cli

        return _cli.main()
    except KeyboardInterrupt:
        print("jaxgear: interrupted", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
