; Dark first: whatever happens to the rest, nothing cures on.
M107
; Then the part out of the vat, straight up, from wherever the plate is.
G91
G1 Z20 F100
G90
M400
; Z stays powered, or the plate could sink back.
