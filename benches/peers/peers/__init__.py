"""Hatbox beside other programs: the same work, the same machine, the same session."""
