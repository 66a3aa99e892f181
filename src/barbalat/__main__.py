"""``barbalat`` and ``python -m barbalat``: the command line. Its modules take a moment to load."""

import sys


def main() -> int:
    """Run one command. Return the exit code. Ctrl-C is handled from the start."""
    try:
        from barbalat.cli import main as command_line

        return command_line()
    except KeyboardInterrupt:  # before the command has begun, or after it has ended
        if sys.stderr is not None:  # None if it is closed
            sys.stderr.write("interrupted\n")
        exec("")  # see barbalat.cli
        return 130


if __name__ == "__main__":
    sys.exit(main())
