"""The sub-commands of `xormocap`: a module each, with its options and what it prints."""
