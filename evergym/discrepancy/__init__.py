"""Find what a model lacks: measured datasets, their simulation, and the diagnosis of the difference.

A dataset is read by `evergym.discrepancy.dataset_reading.load_dataset`, simulated by
`evergym.discrepancy.simulate.simulate_run`, and a user's own effect joins as a `evergym.discrepancy.hook.UserEffect`.
"""

from __future__ import annotations

__all__: list[str] = []
