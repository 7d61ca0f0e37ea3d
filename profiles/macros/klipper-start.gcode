; Undo what an earlier job may have left behind; the file sets its own modes.
G90
M82
M220 S100
M221 S100
