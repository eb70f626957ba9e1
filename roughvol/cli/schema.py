"""The command `schema`: the JSON schema of study files."""

from __future__ import annotations

import json

from roughvol.cli.options import command
from roughvol.cli.output import say


@command
def schema() -> None:
    """Print the JSON schema of study files, for completion and checks in editors."""
    from roughvol.study import json_schema

    say(json.dumps(json_schema(), indent=2, ensure_ascii=False))
