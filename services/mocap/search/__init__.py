"""The search: chains, grid search, line and direction-set minimisers, the first pose."""
