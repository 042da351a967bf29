"""The only unit conversions: files, options and messages speak mm, kPa (gauge) and degrees; the code speaks SI."""

from __future__ import annotations

import math

__all__ = ["DEG", "GRAM", "GRAM_FORCE", "KPA", "MM", "MPA", "UM"]

MM = 1e-3
"""One millimetre [m]."""
UM = 1e-6
"""One micrometre [m]."""
KPA = 1e3
"""One kilopascal [Pa]."""
MPA = 1e6
"""One megapascal [Pa]."""
GRAM = 1e-3
"""One gram [kg]."""
GRAM_FORCE = 9.81e-3
"""The weight of one gram [N], with g = 9.81 m/s^2 as in the paper's loads."""
DEG = math.pi / 180.0
"""One degree [rad]."""
