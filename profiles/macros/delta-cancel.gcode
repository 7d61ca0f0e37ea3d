; Cold first: whatever happens to the rest, nothing stays hot.
M104 S0
M140 S0
M107
; Straight up, and then home, which on a delta is at the top: with the motors
; off the effector would come down under its own weight.
G91
G1 E-2 F1800
G1 Z10 F3000
G90
G28
