"""Every error that evergym raises on purpose: what is wrong, where, the value and the limit, and what to do."""

from __future__ import annotations

__all__ = ["ConfigError", "EvergymError", "GeometryError", "RunError", "SimulationDiverged"]


class EvergymError(Exception):
    """Base of all errors that a user can mend; the command line prints it without a traceback and exits with 1."""


class ConfigError(EvergymError):
    """A model file, command option or argument has an unknown key or an impossible value."""


class GeometryError(EvergymError):
    """A mesh, duct, peg field or target cannot be used by the robot."""


class RunError(EvergymError):
    """A run folder, checkpoint or dataset is missing, incomplete or of another kind."""


class SimulationDiverged(EvergymError):
    """The solver found no equilibrium, even with smaller steps; the state is the last good one."""
