use super::super::gcode::corpus;
use super::*;
