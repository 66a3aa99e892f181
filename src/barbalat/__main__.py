"""``python -m barbalat``: the command line."""

import sys

from barbalat.cli import main

if __name__ == "__main__":
    sys.exit(main())
