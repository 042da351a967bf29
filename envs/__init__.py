"""The gymnasium environments. A class docstring is the environment's specification."""

from __future__ import annotations

if __name__ != "evergym.envs":
    raise ImportError("This folder is the package 'evergym.envs'; write 'import evergym.envs', not 'import envs'.")

__all__: list[str] = []
