"""`python -m jaxgear`, the same as the command `jaxgear`."""

import sys

from jaxgear._app._cli import main

if __name__ == "__main__":
    sys.exit(main())
