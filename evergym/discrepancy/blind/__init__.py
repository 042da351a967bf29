"""The blind campaign: datasets in which an effect is hidden, and how well the diagnosis finds it.

One process draws a truth and writes the dataset and the sealed truth to different folders (`seal`), another diagnoses
the dataset through the public interface only (`campaign`), and only then the two are compared (`score`). The truth may
use code of its own (`alteration` and the `*_forms` modules) where the library has another law, or none.
"""

from __future__ import annotations

__all__: list[str] = []
