//! What a scenario file may say, for people: the one place.

/// The keys of a scenario and what they mean.
pub const HELP: &str = r#"A scenario, in TOML. Unknown keys are errors.

title = "An ok is lost in mid-job"     # one sentence

[job]                    # one of:
lines = 200              # heats, homes, then so many short moves, each unlike all others
gcode = """G28\nG1 X1"""  # these lines
corpus = "demo.gcode"    # a file of gcode/corpus
resin = { layers = 3, exposure_s = 2, timed_by = "pulse", homes_up = true }
                         # layers of resin on the profile generic-msla; timed_by: controller (if
                         # nothing is said), pulse or host; in the virtual world only
                         # and beside `lines`:
start = ["G28", "M109 S200"]   # instead of the usual beginning
insert = { "50" = "M600" }     # a line after so many moves

[printer]                # all optional
personality = "rs"       # a name of the mock's table; a list plays the scenario
                         # once for each
profile = "ender-3"
speed = 4                # how many times faster than life the mechanics are
window_lines = 1         # unacknowledged lines, whatever the profile says
dtr_reset = true         # opening the port resets the board
hard_stop = true         # the host can reset the board

[noise]                  # all optional, all the time; in thousandths of lines
seed = 1
corrupt_line = 10        # to the board, a byte damaged
lose_line = 10
corrupt_reply = 10       # from the board
lose_reply = 10
split = true             # bytes come in random pieces
delay_ms = 20            # pieces come up to so much later

[[fault]]                # any number; each needs one of the first four
at_line = 50             # when the job's 50th command first goes out (from 1);
                         # a list plays the scenario once for each
at_command = "G28"       # when a line with this in it first goes out
at_s = 12.5              # seconds since the port was first opened
at_state = "paused"      # when the job comes to this state
after_s = 2              # so much later
do = "corrupt_line"

on the wire, on the host's side of it:
corrupt_line   byte, times   this line (and the next ones) with a damaged byte
lose_line      times         this line never arrives
lose_end       times         this line loses its line feed
hold_lines     for_s         nothing arrives at the board for so long
corrupt_reply  times         the next ok has a damaged byte
lose_reply     times         the next ok is lost
hold_replies   for_s         nothing arrives at the host for so long
insert         text          these bytes come before the next reply
block          for_s         the port takes no byte for so long
unplug         for_s         the port is gone; the board goes on and keeps its state
the board (a real one only where the rig can):
unplug_reset   for_s         the port is gone, and the board starts anew with it
resend_without_ok            this line is refused, the refusal's ok is missing
drop_ok                      this line is executed, its ok is not sent
say            text          this line comes, such as "//action:pause"
halt           text          "Error:" and this text, then the board halts
reset                        the board starts anew, as after a brown-out
hang           for_s         the board does nothing for so long
power_cut      for_s, sag_mm the printer has no power for so long; Z sinks meanwhile
filament_out                 the run-out sensor speaks
the host and its user:
pause, resume, cancel, emergency_stop
answer         button        to the printer's question, the button's place from 0
send           text          a command beside the job
kill           for_s         kill -9; after so long `jobs resume` takes the job up
confirm                      a person says that part and nozzle are clear, and resumes
change_file                  the job's file is another from here on
the journal's disk:
disk_slow      for_s         every sync takes so long from here on
disk_fails     for_s         every write fails for so long

[expect]
outcome = "finished"     # finished, cancelled, failed, interrupted, refused
twice_at_most = 0        # commands that may be gone over twice; none is ever left out
stall_s = 3.5            # longest time in which no new command of the job goes out
over_s = 20              # longest time from the first fault to the end
cold_s = 3               # longest time from the first fault to heaters off
heaters = "any"          # nothing is asked of the heaters at the end
told = ["reset"]         # words that the user must be told
commands = ["M108"]      # commands that the board must get, in this order
boots = 2                # how often the board may start
none_after = 50          # nothing of the job is executed after its 50th command

Always: commands of the job in order and none left out; heaters off at the end unless
the end is `interrupted`; nothing moves where it could hit the part; no hang.
"#;
