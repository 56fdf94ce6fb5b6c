"""``python -m belt_fenicsx``."""

import sys

from belt_fenicsx.cli import main

if __name__ == "__main__":
    sys.exit(main())
