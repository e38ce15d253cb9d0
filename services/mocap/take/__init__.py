"""The take folder: its settings, videos, silhouettes and tables, read, checked and written."""
