"""The physics: pure functions of arrays and numbers; no files, no study, no printing (floor 1)."""
