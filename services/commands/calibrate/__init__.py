"""`xormocap calibrate`: calibrates cameras by a board or measured points, converts other tools' files,
matches colours, and checks or refines with silhouettes."""
