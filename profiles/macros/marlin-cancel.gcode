; Cold first: whatever happens to the rest, nothing stays hot.
M104 S0
M140 S0
M107
; Then clear of the part, straight up, from wherever the head is.
G91
G1 E-2 F1800
G1 Z10 F600
G90
; Z stays powered, or the gantry could sink onto the part.
M84 X Y E
