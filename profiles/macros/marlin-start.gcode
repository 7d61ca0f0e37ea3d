; Undo what an earlier job may have left behind; the file sets its own modes.
G90 ; absolute positions, and with them absolute E
M220 S100 ; speed factor
M221 S100 ; flow factor
