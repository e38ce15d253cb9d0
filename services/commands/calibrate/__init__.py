"""`xormocap calibrate`: calibrates cameras from clips of a board or other tools' files, or checks them with
silhouettes."""
