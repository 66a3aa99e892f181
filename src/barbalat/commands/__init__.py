"""The commands, one file each, with options and work. Heavy packages are imported only when the command runs."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import argparse

    from barbalat.commands.options import Parser

    Commands = argparse._SubParsersAction[Parser]
