"""Limb worker: solves limb tasks for a coordinator (the paper's client)."""
