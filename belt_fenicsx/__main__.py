"""``python -m belt_fenicsx``."""

import sys

from belt_fenicsx.command.main import main

if __name__ == "__main__":
    sys.exit(main())
