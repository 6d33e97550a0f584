"""The command `puppetline`, and ``python -m puppetline``."""

import sys


def run() -> None:
    """Start the command line; Ctrl-C while it is still being loaded ends quietly too."""
    try:
        from engine_bridge.cli import main

        main()
    except KeyboardInterrupt:
        sys.exit("puppetline: stopped")


if __name__ == "__main__":
    run()
