//! First in line for a core, for a thread that must not be late.
//!
//! Where the system allows it (`LimitRTPRIO` of a systemd unit, or root). Without it a thread waits behind
//! whatever else runs, for some milliseconds, or tens of them on a busy machine.
use thread_priority::{
    RealtimeThreadSchedulePolicy, ThreadPriority, ThreadSchedulePolicy, set_thread_priority_and_policy,
    thread_native_id,
};

/// Low among real-time threads: the kernel's own (interrupts have 50) go first.
const PRIORITY: u8 = 10;

/// The calling thread, and every process that it starts, is first in line from now on. `false` where the
/// system does not allow it.
pub(crate) fn first_in_line() -> bool {
    let fifo = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
    let Ok(priority) = PRIORITY.try_into() else { return false };
    let priority = ThreadPriority::Crossplatform(priority);
    set_thread_priority_and_policy(thread_native_id(), priority, fifo).is_ok()
}
