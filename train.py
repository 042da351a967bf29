"""Train a policy: the same as ``evergym train``."""

from __future__ import annotations

import sys

from evergym.agents.cli import main

if __name__ == "__main__":
    sys.exit(main(["train", *sys.argv[1:]]))
