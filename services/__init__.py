"""The services of xormocap, each a folder with its own `__main__`, and the library that they share."""
