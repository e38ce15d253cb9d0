"""The folder of a run's results: its files, and how it is read back."""
