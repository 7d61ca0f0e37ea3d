//! From thread to thread in batches, so that small layers do not cost a wake-up each.
//!
//! Takes items with their sizes, gives them in order to a receiver of batches; a
//! batch is sent when it is large enough, so large items go one by one and what
//! waits stays bounded by the largest of them. Knows not what the items are.
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

/// Batches that wait between two threads. One keeps both at work; more costs memory.
const WAITING_BATCHES: usize = 0;

/// A batch of this size is sent, bytes. Waking a thread takes as long as
/// processing some kilobytes; a usual layer has 5 to 50 kB.
const BATCH_BYTES: usize = 64 << 10;

/// The sending end.
pub(super) struct Batches<T> {
    sender: SyncSender<Vec<T>>,
    batch: Vec<T>,
    bytes: usize,
}

/// The receiver has stopped; it tells why.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Gone;

/// Both ends; the receiver's `iter().flatten()` gives the items.
pub(super) fn batches<T>() -> (Batches<T>, Receiver<Vec<T>>) {
    let (sender, receiver) = sync_channel(WAITING_BATCHES);
    (Batches { sender, batch: Vec::new(), bytes: 0 }, receiver)
}

impl<T> Batches<T> {
    /// Puts in an item of so many bytes.
    pub(super) fn put(&mut self, item: T, bytes: usize) -> Result<(), Gone> {
        self.batch.push(item);
        self.bytes += bytes;
        if self.bytes < BATCH_BYTES {
            return Ok(());
        }
        self.bytes = 0;
        self.sender.send(std::mem::take(&mut self.batch)).map_err(|_| Gone)
    }

    /// Sends what is left. Without it the last items are lost.
    pub(super) fn finish(self) -> Result<(), Gone> {
        if self.batch.is_empty() { Ok(()) } else { self.sender.send(self.batch).map_err(|_| Gone) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Sizes of the batches in which items of these sizes arrive.
    fn arrived(sizes: &[usize]) -> Vec<Vec<usize>> {
        let (mut sender, receiver) = batches();
        std::thread::scope(|scope| {
            let received = scope.spawn(move || receiver.into_iter().collect());
            for &size in sizes {
                sender.put(size, size).unwrap();
            }
            sender.finish().unwrap();
            received.join().unwrap()
        })
    }

    #[test]
    fn small_items_go_together_and_large_ones_alone() {
        let check = |sizes: &[usize], expect: &[&[usize]]| assert_eq!(arrived(sizes), expect, "{sizes:?}");
        check(&[], &[]);
        check(&[1, 2], &[&[1, 2]]);
        check(&[BATCH_BYTES, 1], &[&[BATCH_BYTES], &[1]]);
        check(&[1, BATCH_BYTES - 1, 2], &[&[1, BATCH_BYTES - 1], &[2]]);
        check(&[1, BATCH_BYTES * 9], &[&[1, BATCH_BYTES * 9]]);
    }

    #[test]
    fn a_receiver_that_stopped_is_noticed() {
        let (mut sender, receiver) = batches();
        drop(receiver);
        assert_eq!(sender.put(1, 1), Ok(()));
        assert_eq!(sender.put(2, BATCH_BYTES), Err(Gone));
        assert_eq!(sender.finish(), Ok(()));
    }

    proptest! {
        #[test]
        fn nothing_is_lost_and_the_order_stays(sizes in proptest::collection::vec(0..BATCH_BYTES * 2, 0..40)) {
            prop_assert_eq!(arrived(&sizes).concat(), sizes);
        }
    }
}
