"""The command line: the only place that prints, draws progress and exits.

Options choose how a study is run. The physics is in the study alone. A command parses its options, calls a function of
`roughvol`, most of them in `questions`, and prints the answer.

=============  ================================================
`group`        the group of all commands: help page, errors, exit codes
`options`      arguments and options that commands share
`output`       what is printed: lines, tables, CSV, JSON
=============  ================================================

Each other module is the command of its name.
"""

import os
import sys

if os.name != "posix":  # files are locked and limits are asked for as Unix does
    sys.exit("error: roughvol needs Linux or another Unix; on Windows install it in WSL")

from roughvol.cli.group import main

__all__ = ["main"]
