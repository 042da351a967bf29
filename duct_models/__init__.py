"""Where the robot goes: ducts, peg fields, their walls and centrelines. Geometry only."""

from __future__ import annotations

if __name__ != "evergym.duct_models":
    raise ImportError(
        "This folder is the package 'evergym.duct_models'; write 'import evergym.duct_models', not 'duct_models'."
    )

__all__: list[str] = []
