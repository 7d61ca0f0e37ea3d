; Cold first: Klipper answers a move that it cannot make (not homed, at the
; top) with an error, and by then nothing may still be hot.
TURN_OFF_HEATERS
M107
; Then clear of the part. The motors stay on until Klipper's own idle timeout:
; without them a belted gantry sinks.
G91
G1 Z5 F600
G90
