"""`xormocap calibrate`: cameras from clips of a board, from other tools' files, or checked by silhouettes."""
