//! The serial line as the board sees it: bytes that take time, a small
//! receive buffer that overflows, a transmitter that holds the board up.
//!
//! Takes bytes and the time in nanoseconds, gives bytes when they have
//! arrived. Knows no protocol and no clock.
use std::collections::VecDeque;

/// Bytes that the host may have written and that have not reached the board:
/// what a USB-serial driver keeps before it makes the host wait.
pub(crate) const WIRE_BYTES_MAX: usize = 4096;

/// Reply bytes kept for a host that does not read. A real line would lose
/// them one by one; this much is a pseudo-terminal's own buffer many times over.
const OUT_BYTES_MAX: usize = 64 * 1024;

/// Start bit, eight data bits, stop bit.
const BITS_PER_BYTE: u64 = 10;

/// Both directions of the line, and the receive buffer behind it.
#[derive(Debug)]
pub(crate) struct Uart {
    /// Time of one byte on the wire; 0 is a line without a speed limit.
    byte_ns: u64,
    /// Written by the host, not yet arrived.
    wire: VecDeque<u8>,
    /// When the first byte of `wire` has arrived.
    wire_next_ns: u64,
    /// When the wire became idle.
    wire_idle_ns: u64,
    rx: VecDeque<u8>,
    rx_usable: usize,
    /// Reply bytes, the end of each piece with the time it is out.
    out: VecDeque<u8>,
    pieces: VecDeque<(u64, usize)>,
    tx_free_ns: u64,
    /// From the last bit of a reply to the host.
    latency_ns: u64,
    /// Bytes dropped because the receive buffer was full.
    pub(crate) overflow_bytes: u64,
    /// Most bytes that waited in the receive buffer.
    pub(crate) rx_bytes_most: usize,
    /// Reply bytes dropped because nobody read.
    pub(crate) unread_bytes: u64,
}

impl Uart {
    /// `baud` 0 is a line without a speed limit. `rx_bytes` is the firmware's
    /// RX_BUFFER_SIZE: a ring that holds one byte less.
    pub(crate) fn new(baud: u32, rx_bytes: usize) -> Self {
        Self {
            byte_ns: if baud == 0 { 0 } else { BITS_PER_BYTE * 1_000_000_000 / u64::from(baud) },
            wire: VecDeque::with_capacity(WIRE_BYTES_MAX),
            wire_next_ns: 0,
            wire_idle_ns: 0,
            rx: VecDeque::with_capacity(rx_bytes),
            rx_usable: rx_bytes.saturating_sub(1).max(1),
            out: VecDeque::new(),
            pieces: VecDeque::new(),
            tx_free_ns: 0,
            latency_ns: 0,
            overflow_bytes: 0,
            rx_bytes_most: 0,
            unread_bytes: 0,
        }
    }

    /// The same with an adapter that holds replies back for so long.
    pub(crate) fn with_latency(self, latency_ns: u64) -> Self {
        Self { latency_ns, ..self }
    }

    /// How many bytes [`Self::write`] takes now.
    pub(crate) fn room(&self) -> usize {
        WIRE_BYTES_MAX - self.wire.len()
    }

    /// The host wrote these bytes now; what exceeds [`Self::room`] is refused.
    pub(crate) fn write(&mut self, now_ns: u64, bytes: &[u8]) {
        if self.wire.is_empty() {
            self.wire_next_ns = now_ns.max(self.wire_idle_ns) + self.byte_ns;
        }
        let room = self.room();
        self.wire.extend(&bytes[..bytes.len().min(room)]);
    }

    /// When the next byte arrives.
    pub(crate) fn next_arrival_ns(&self) -> Option<u64> {
        (!self.wire.is_empty()).then_some(self.wire_next_ns)
    }

    /// When the next line end arrives, or else the last byte on the wire.
    pub(crate) fn next_line_ns(&self) -> Option<u64> {
        if self.byte_ns == 0 && !self.wire.is_empty() {
            return Some(self.wire_next_ns);
        }
        let bytes = match self.wire.iter().position(|b| is_line_end(*b)) {
            Some(at) => at,
            None => self.wire.len().checked_sub(1)?,
        };
        Some(self.wire_next_ns + self.byte_ns * bytes as u64)
    }

    /// Takes the byte that arrives now off the wire.
    pub(crate) fn arrive(&mut self) -> Option<u8> {
        let byte = self.wire.pop_front()?;
        self.wire_idle_ns = self.wire_next_ns;
        self.wire_next_ns += self.byte_ns;
        Some(byte)
    }

    /// Puts an arrived byte into the receive buffer; false when it is full
    /// and the byte is lost.
    pub(crate) fn keep(&mut self, byte: u8) -> bool {
        if self.rx_is_full() {
            self.overflow_bytes += 1;
            return false;
        }
        self.rx.push_back(byte);
        self.rx_bytes_most = self.rx_bytes_most.max(self.rx.len());
        true
    }

    pub(crate) fn rx_is_full(&self) -> bool {
        self.rx.len() >= self.rx_usable
    }

    pub(crate) fn rx_is_empty(&self) -> bool {
        self.rx.is_empty()
    }

    /// The next byte out of the receive buffer.
    pub(crate) fn read(&mut self) -> Option<u8> {
        self.rx.pop_front()
    }

    /// Throws away what waits in the receive buffer (not what is on the wire).
    pub(crate) fn flush_rx(&mut self) {
        self.rx.clear();
    }

    /// Sends reply bytes; they are out when the transmitter has shifted them.
    pub(crate) fn send(&mut self, now_ns: u64, bytes: &[u8]) {
        if self.out.len() + bytes.len() > OUT_BYTES_MAX {
            self.unread_bytes += bytes.len() as u64;
            return;
        }
        self.tx_free_ns = self.tx_free_ns.max(now_ns) + self.byte_ns * bytes.len() as u64;
        self.out.extend(bytes);
        let there_ns = self.tx_free_ns + self.latency_ns;
        match self.pieces.back_mut() {
            Some(last) if last.0 == there_ns => last.1 += bytes.len(),
            _ => self.pieces.push_back((there_ns, bytes.len())),
        }
    }

    /// When the transmitter is free: Marlin has no transmit buffer by default
    /// (TX_BUFFER_SIZE 0) and does nothing else while it sends.
    pub(crate) fn tx_free_ns(&self) -> u64 {
        self.tx_free_ns
    }

    /// When the next reply bytes are out.
    pub(crate) fn next_output_ns(&self) -> Option<u64> {
        self.pieces.front().map(|piece| piece.0)
    }

    /// Moves the reply bytes that are out by now to the end of `to`.
    pub(crate) fn take_output(&mut self, now_ns: u64, to: &mut Vec<u8>) {
        while let Some(&(ready_ns, bytes)) = self.pieces.front() {
            if ready_ns > now_ns {
                break;
            }
            self.pieces.pop_front();
            to.extend(self.out.drain(..bytes));
        }
    }

    /// The cable is pulled out: what is on it goes nowhere.
    pub(crate) fn unplug(&mut self) {
        self.wire.clear();
        self.out.clear();
        self.pieces.clear();
    }

    /// Takes the bytes off the wire that have arrived by then and belong to a line whose
    /// end is still to come; gives when the last of them arrived.
    pub(crate) fn take_run(&mut self, until_ns: u64, to: &mut Vec<u8>) -> Option<u64> {
        if self.wire.is_empty() || self.wire_next_ns > until_ns {
            return None;
        }
        let arrived = match self.byte_ns {
            0 => self.wire.len(),
            byte_ns => ((until_ns - self.wire_next_ns) / byte_ns + 1).min(WIRE_BYTES_MAX as u64) as usize,
        };
        let (front, _) = self.wire.as_slices();
        let front = &front[..front.len().min(arrived)];
        let bytes = front.iter().position(|b| is_line_end(*b)).unwrap_or(front.len());
        if bytes == 0 {
            return None;
        }
        to.extend_from_slice(&front[..bytes]);
        self.wire.drain(..bytes);
        let last_ns = self.wire_next_ns + self.byte_ns * (bytes as u64 - 1);
        self.wire_idle_ns = last_ns;
        self.wire_next_ns = last_ns + self.byte_ns;
        Some(last_ns)
    }

    /// A reset of the board: what it had received and what it was sending is gone.
    /// What the adapter holds already is not.
    pub(crate) fn reset(&mut self, now_ns: u64) {
        self.rx.clear();
        while self.pieces.back().is_some_and(|p| p.0 > now_ns + self.latency_ns) {
            if let Some((_, bytes)) = self.pieces.pop_back() {
                self.out.truncate(self.out.len() - bytes);
            }
        }
        self.tx_free_ns = now_ns;
    }
}

pub(crate) fn is_line_end(byte: u8) -> bool {
    byte == b'\n' || byte == b'\r'
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_arrive_at_the_speed_of_the_line() {
        let mut uart = Uart::new(250_000, 128);
        uart.write(1_000, b"ab\ncd");
        assert_eq!(uart.next_arrival_ns(), Some(41_000));
        assert_eq!(uart.next_line_ns(), Some(121_000));
        assert_eq!(uart.arrive(), Some(b'a'));
        assert_eq!(uart.next_arrival_ns(), Some(81_000));
        for _ in 0..4 {
            uart.arrive();
        }
        assert_eq!(uart.next_arrival_ns(), None);
        // The line is busy with the last byte until 201 us.
        uart.write(150_000, b"x");
        assert_eq!(uart.next_arrival_ns(), Some(241_000));
        uart.arrive();
        uart.write(900_000, b"x");
        assert_eq!(uart.next_arrival_ns(), Some(940_000));
        // A run of bytes takes what has arrived, and no line end.
        uart.write(900_000, b"yz\nu");
        let mut run = Vec::new();
        assert_eq!(uart.take_run(939_999, &mut run), None);
        assert_eq!(uart.take_run(980_000, &mut run), Some(980_000));
        assert_eq!(uart.take_run(2_000_000, &mut run), Some(1_020_000));
        assert_eq!((run.as_slice(), uart.take_run(2_000_000, &mut Vec::new())), (b"xyz".as_slice(), None));
        assert_eq!(uart.next_arrival_ns(), Some(1_060_000));
    }

    #[test]
    fn a_full_receive_buffer_loses_bytes() {
        let mut uart = Uart::new(0, 8);
        for n in 0..10 {
            assert_eq!(uart.keep(n), n < 7);
        }
        assert_eq!((uart.overflow_bytes, uart.rx_bytes_most), (3, 7));
        assert_eq!(uart.read(), Some(0));
        assert!(uart.keep(9));
    }

    #[test]
    fn replies_are_out_when_they_were_sent_whole() {
        let mut uart = Uart::new(1_000_000, 8);
        let mut out = Vec::new();
        uart.send(0, b"ok\n");
        uart.send(0, b"abc\n");
        assert_eq!(uart.next_output_ns(), Some(30_000));
        uart.take_output(29_999, &mut out);
        assert_eq!(out, b"");
        uart.take_output(69_999, &mut out);
        assert_eq!(out, b"ok\n");
        uart.reset(69_999);
        uart.take_output(100_000, &mut out);
        assert_eq!(out, b"ok\n", "a reset cuts off what was being sent");
    }

    #[test]
    fn an_adapter_holds_replies_back_but_not_the_board() {
        let mut uart = Uart::new(1_000_000, 8).with_latency(1_000);
        let mut out = Vec::new();
        uart.send(0, b"ok\n");
        assert_eq!((uart.tx_free_ns(), uart.next_output_ns()), (30_000, Some(31_000)));
        uart.send(30_000, b"abc\n");
        uart.reset(30_500);
        uart.take_output(30_999, &mut out);
        assert_eq!(out, b"");
        uart.take_output(100_000, &mut out);
        assert_eq!(out, b"ok\n", "only what had left the board before the reset");
    }

    #[test]
    fn nothing_grows_without_bound() {
        let mut uart = Uart::new(9600, 64);
        uart.write(0, &[b'x'; 3 * WIRE_BYTES_MAX]);
        assert_eq!(uart.room(), 0);
        for _ in 0..1000 {
            uart.send(0, &[b'x'; 100]);
        }
        assert!(uart.out.len() <= OUT_BYTES_MAX && uart.unread_bytes > 0);
    }
}
