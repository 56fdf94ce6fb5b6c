"""``python -m belt_fenicsx``, and the command ``belt-fenicsx``."""

import sys


def run() -> int:
    """Runs the command line; Ctrl-C while it is imported ends it as later on, with nothing to be said."""
    try:
        from belt_fenicsx.command.main import main
    except KeyboardInterrupt:
        return 130
    return main()


if __name__ == "__main__":
    sys.exit(run())
