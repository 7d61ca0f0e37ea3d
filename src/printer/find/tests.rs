//! Over made-up folders of the system, and over pseudo-terminals with a mock behind.
use super::baud::{Detect, LIKELY, rates};
use super::*;
use crate::printer::mock;
use proptest::prelude::*;
use std::fs;
use std::os::unix::fs::symlink;
use std::path::Path;
use std::time::Duration;

/// A system's folders, to plug devices into.
struct Machine {
    root: tempfile::TempDir,
}

impl Machine {
    fn new() -> Self {
        let root = tempfile::tempdir().unwrap();
        for folder in ["class", "dev/serial/by-id", "devices"] {
            fs::create_dir_all(root.path().join(folder)).unwrap();
        }
        Self { root }
    }

    fn places(&self) -> Places {
        Places { classes: self.root.path().join("class"), devices: self.root.path().join("dev") }
    }

    fn node(&self, name: &str) -> String {
        self.root.path().join("dev").join(name).to_string_lossy().into_owned()
    }

    fn port(&self, name: &str, device: &Path) {
        let class = self.root.path().join("class").join(name);
        fs::create_dir_all(&class).unwrap();
        fs::create_dir_all(device).unwrap();
        symlink(device, class.join("device")).unwrap();
        fs::write(self.node(name), "").unwrap();
    }

    /// A USB serial port as `socket` `vendor:product` `serial`; `-`: no number.
    fn plug(&self, name: &str, socket: &str, ids: &str, serial: &str) {
        let usb = self.root.path().join("devices").join(socket);
        let interface = usb.join(format!("{socket}:1.0"));
        self.port(name, &interface.join(name));
        let (vendor, product) = ids.split_once(':').unwrap();
        for (file, text) in [("idVendor", vendor), ("idProduct", product), ("product", "A bridge")] {
            fs::write(usb.join(file), format!("{text}\n")).unwrap();
        }
        if serial != "-" {
            fs::write(usb.join("serial"), format!("{serial}\n")).unwrap();
        }
        fs::write(interface.join("bInterfaceNumber"), "00\n").unwrap();
        fs::write(interface.join(name).join("port_number"), "0\n").unwrap();
    }

    fn unplug(&self, name: &str) {
        fs::remove_file(self.node(name)).unwrap();
        fs::remove_dir_all(self.root.path().join("class").join(name)).unwrap();
    }
}

fn names(found: &[Found]) -> Vec<&str> {
    found.iter().map(Found::name).collect()
}

#[test]
fn ports_are_listed_with_what_they_say() {
    let machine = Machine::new();
    let root = machine.root.path().to_owned();
    machine.plug("ttyUSB10", "1-1.3", "1a86:7523", "-");
    machine.plug("ttyUSB9", "1-1.2", "0403:6001", "A50285BI");
    machine.port("ttyAMA0", &root.join("devices/uart0"));
    machine.port("ttyS0", &root.join("devices/uart1"));
    machine.port("ttyS1", &root.join("devices/uart2"));
    fs::write(root.join("class/ttyS0/type"), "4\n").unwrap();
    fs::write(root.join("class/ttyS1/type"), "0\n").unwrap();
    fs::create_dir_all(root.join("class/tty1")).unwrap();
    symlink(machine.node("ttyUSB9"), root.join("dev/serial/by-id/usb-FTDI_A50285BI-if00-port0")).unwrap();

    let found = scan(&machine.places());
    assert_eq!(names(&found), ["ttyUSB9", "ttyUSB10", "ttyAMA0", "ttyS0"]);
    let usb = found[0].usb.clone().unwrap();
    assert_eq!((usb.vendor, usb.product, usb.serial.as_deref()), (0x0403, 0x6001, Some("A50285BI")));
    assert_eq!((usb.location.as_str(), usb.interface.as_str()), ("1-1.2", "00/0"));
    assert!(found[0].by_id.as_ref().unwrap().ends_with("usb-FTDI_A50285BI-if00-port0"));
    let handles: Vec<String> = found.iter().map(|p| p.handle(&found)).collect();
    assert_eq!(handles[0], "usb:A50285BI");
    assert_eq!(handles[1], machine.node("ttyUSB10"));
    let printers: Vec<bool> = found.iter().map(Found::may_be_printer).collect();
    assert_eq!(printers, [true, true, true, false]);
}

/// Numbers that would do harm in a command line, or that two have, are no handle.
#[test]
fn a_handle_is_safe_and_unique() {
    let check = |serials: &[&str], expect: &[Option<&str>]| {
        let machine = Machine::new();
        for (at, serial) in serials.iter().enumerate() {
            machine.plug(&format!("ttyUSB{at}"), &format!("1-{at}"), "1a86:7523", serial);
        }
        let found = scan(&machine.places());
        for (port, expect) in found.iter().zip(expect) {
            let path = port.path.clone();
            assert_eq!(port.handle(&found), expect.map_or(path, |s| format!("usb:{s}")), "{serials:?}");
        }
    };
    check(&["AB12", "AB13"], &[Some("AB12"), Some("AB13")]);
    check(&["AB12", "AB12"], &[None, None]);
    check(&["A;rm -rf ~", "123", "-"], &[None, None, None]);
    check(&["\u{1b}[2Jxxxx"], &[None]);
}

#[test]
fn what_a_user_says() {
    let check = |text: &str, expect: Wanted| {
        assert_eq!(text.parse::<Wanted>().unwrap(), expect);
        assert_eq!(expect.to_string(), text);
    };
    check("/dev/ttyUSB0", Wanted::Path("/dev/ttyUSB0".into()));
    check("auto", Wanted::Auto);
    check("usb:A50285BI", Wanted::Usb("A50285BI".into()));
    check("usb:1a86:7523", Wanted::Usb("1a86:7523".into()));
    assert!("usb:".parse::<Wanted>().is_err());
}

#[test]
fn a_usb_number_finds_one_or_says_what_there_is() {
    let machine = Machine::new();
    machine.plug("ttyUSB0", "1-1", "0403:6001", "A50285BI");
    machine.plug("ttyUSB1", "1-2", "0403:6001", "A50285");
    machine.plug("ttyACM0", "1-3", "2c99:0002", "CZPX2018X004XC12345");
    machine.plug("ttyUSB2", "1-4", "1a86:7523", "-");
    let all = scan(&machine.places());
    let check = |number: &str, expect: Result<&str, &str>| match (by_number(number, &all), expect) {
        (Ok(found), Ok(name)) => assert_eq!(found.name(), name, "{number}"),
        (Err(e), Err(words)) => assert!(e.to_string().contains(words), "{number}: {e}"),
        (got, expect) => panic!("{number}: {got:?}, not {expect:?}"),
    };
    check("A50285", Ok("ttyUSB1")); // the whole number goes before a part of one
    check("a50285bi", Ok("ttyUSB0"));
    check("XC12345", Ok("ttyACM0"));
    check("2C99:0002", Ok("ttyACM0"));
    check("1a86:7523", Ok("ttyUSB2"));
    check("0403:6001", Err("usb:0403:6001 is more than one: say which of usb:A50285BI, usb:A50285"));
    check("A5028", Err("more than one"));
    check("nobody", Err("no printer is usb:nobody; there are: usb:CZPX2018X004XC12345, usb:A50285BI"));
    let none = by_number("x", &[]).unwrap_err().to_string();
    assert!(none.contains("no USB serial port at all"), "{none}");
}

/// The same printer comes back under another name, and another printer under its.
#[test]
fn a_printer_is_the_same_one_again() {
    let check = |serial: &str, back: (&str, &str, &str), expect: Option<&str>| {
        let machine = Machine::new();
        machine.plug("ttyUSB0", "1-1", "1a86:7523", serial);
        let identity = Identity::of(&machine.node("ttyUSB0"), &machine.places());
        assert_eq!(identity.path_now(&machine.places()), Some(machine.node("ttyUSB0")));
        machine.unplug("ttyUSB0");
        assert_eq!(identity.path_now(&machine.places()), None);
        machine.plug(back.0, back.1, "1a86:7523", back.2);
        let now = identity.path_now(&machine.places());
        assert_eq!(now, expect.map(|name| machine.node(name)), "{serial} {back:?}");
    };
    check("AB12", ("ttyUSB0", "1-1", "AB12"), Some("ttyUSB0"));
    check("AB12", ("ttyUSB7", "1-9", "AB12"), Some("ttyUSB7"));
    check("AB12", ("ttyUSB0", "1-2", "CD34"), None);
    check("-", ("ttyUSB3", "1-1", "-"), Some("ttyUSB3"));
    check("-", ("ttyUSB0", "1-2", "-"), None);
    check("-", ("ttyUSB0", "1-2", "AB12"), None);
}

/// Of two with the same number the socket tells which it was; a link is followed.
#[test]
fn sockets_and_links_tell_twins_apart() {
    let machine = Machine::new();
    machine.plug("ttyUSB0", "1-1", "1a86:7523", "0001");
    machine.plug("ttyUSB1", "1-2", "1a86:7523", "0001");
    let second = Identity::of(&machine.node("ttyUSB1"), &machine.places());
    assert_eq!(second.path_now(&machine.places()), Some(machine.node("ttyUSB1")));

    let link = machine.node("printer");
    symlink(machine.node("ttyUSB0"), &link).unwrap();
    let linked = Identity::of(&link, &machine.places());
    assert_eq!(linked.path_now(&machine.places()), Some(link.clone()));
    machine.unplug("ttyUSB0");
    assert_eq!(linked.path_now(&machine.places()), None);
    fs::remove_file(&link).unwrap();
    symlink(machine.node("ttyUSB1"), &link).unwrap();
    assert_eq!(linked.path_now(&machine.places()), Some(link));
}

/// What a printer at `right` baud does with what it is asked.
struct Printer {
    right: u32,
    /// Silent until then.
    boots_ms: u64,
    /// What it says when it has booted, then as answer to each line feed.
    says: [&'static [u8]; 2],
    /// What anybody at another speed reads of it.
    noise: &'static [u8],
}

/// Runs a search on a virtual clock; gives the verdict, its time, and how often it
/// asked.
fn search(mut detect: Detect, printer: &Printer) -> (Verdict, u64, usize) {
    let (mut now_ms, mut asked, mut awake) = (0, 0, false);
    for _ in 0..1000 {
        if let Some(verdict) = detect.verdict() {
            return (verdict.clone(), now_ms, asked);
        }
        let heard = |text: &'static [u8], detect: &Detect| match detect.baud() == printer.right {
            true => text,
            false if text.is_empty() => b"",
            false => printer.noise,
        };
        if !awake && now_ms >= printer.boots_ms {
            awake = true;
            let bytes = heard(printer.says[0], &detect);
            detect.on_bytes(bytes, now_ms);
        } else if !detect.output().is_empty() {
            asked += 1;
            let question = detect.output().to_vec();
            assert!([&b"\nM105\n"[..], b"\nM115\n"].contains(&question.as_slice()), "harmless");
            detect.written(question.len());
            if awake {
                let bytes = heard(printer.says[1], &detect);
                detect.on_bytes(bytes, now_ms + 20);
            }
        } else {
            let boots = if awake { u64::MAX } else { printer.boots_ms };
            now_ms = detect.deadline().min(boots).max(now_ms);
            detect.on_tick(now_ms);
        }
    }
    panic!("a search ends");
}

fn speaks(baud: u32) -> Verdict {
    Verdict::Speaks { baud, firmware: None }
}

#[test]
fn the_speed_is_found() {
    let check = |printer: Printer, boot_ms: u64, expect: Verdict, within_ms: u64| {
        let (verdict, at_ms, _) = search(Detect::new(rates(115_200), boot_ms, false, 0), &printer);
        assert_eq!(verdict, expect);
        assert!(at_ms <= within_ms, "{at_ms} ms for {expect:?}");
    };
    let talks = |right| Printer { right, boots_ms: 0, says: [b"", b"ok T:20.0 /0.0\n"], noise: b"\x80\xfe" };
    check(talks(115_200), 0, speaks(115_200), 0);
    for (at, rate) in rates(115_200).into_iter().enumerate() {
        check(talks(rate), 0, speaks(rate), 700 * at as u64);
    }
    // A board that opening resets: `start` is enough, unreadable talk ends the boot.
    let boots = |right| Printer { boots_ms: 1500, says: [b"start\n", b"ok T:20.0 /0.0\n"], ..talks(right) };
    check(boots(115_200), 2500, speaks(115_200), 1500);
    check(boots(250_000), 2500, speaks(250_000), 1500 + 500 + 700);
    // Busy with homing: it says so, and that is enough.
    let busy = Printer { says: [b"", b"echo:busy: processing\n"], ..talks(115_200) };
    check(busy, 0, speaks(115_200), 0);
    // Klipper's words, and an old firmware's.
    check(Printer { says: [b"", b"ok B:21.0 /0.0 T0:20.0 /0.0\n"], ..talks(115_200) }, 0, speaks(115_200), 0);
    check(
        Printer { says: [b"", b"echo:Unknown command: \"\x1a\"\n"], noise: b"~~~\n", ..talks(9_600) },
        0,
        Verdict::Noise,
        14_500,
    );
    let silent = Printer { says: [b"", b""], ..talks(9_600) };
    check(silent, 0, Verdict::Silence, 10 * 700 + 3 * 2500);
    let silent = Printer { says: [b"", b""], ..talks(9_600) };
    check(silent, 2500, Verdict::Silence, 2500 + 10 * 700 + 3 * 2500);
    // A port that talks, but is no printer.
    let modem = Printer { says: [b"", b"ERROR\r\nNO CARRIER\r\n"], ..talks(115_200) };
    check(modem, 0, Verdict::Noise, 14_500);
}

#[test]
fn the_name_is_asked_for_once_the_speed_is_known() {
    let named = Printer {
        right: 115_200,
        boots_ms: 0,
        says: [b"", b"FIRMWARE_NAME:Marlin 2.1.2.1 SOURCE_CODE_URL:x\nCap:EEPROM:1\nok\n"],
        noise: b"",
    };
    let firmware = Some("Marlin 2.1.2.1".to_owned());
    let (verdict, ..) = search(Detect::new(rates(250_000), 0, true, 0), &named);
    assert_eq!(verdict, Verdict::Speaks { baud: 115_200, firmware });
    // One that does not know M115 is not waited for endlessly.
    let nameless = Printer { says: [b"", b"ok\n"], ..named };
    let (verdict, at_ms, asked) = search(Detect::new(rates(115_200), 0, true, 0), &nameless);
    assert_eq!((verdict, at_ms, asked), (speaks(115_200), 20 + 3000, 2));
}

proptest! {
    /// Whatever comes, a search ends in its time and claims no speed for noise.
    #[test]
    fn noise_is_no_printer(noise in prop::collection::vec(prop::collection::vec(128_u8.., 0..40), 0..40)) {
        let mut detect = Detect::new(rates(57_600), 2500, true, 0);
        let (mut now_ms, mut chunks) = (0, noise.iter());
        while detect.verdict().is_none() {
            let out = detect.output().len();
            detect.written(out);
            if let Some(chunk) = chunks.next() {
                detect.on_bytes(chunk, now_ms);
            }
            now_ms = detect.deadline().max(now_ms);
            detect.on_tick(now_ms);
        }
        let claimed = matches!(detect.verdict(), Some(Verdict::Speaks { .. }));
        prop_assert!(!claimed);
        prop_assert!(now_ms <= 2500 + 9 * 700 + 3 * 2500);
    }
}

#[test]
fn the_list_of_speeds_has_none_twice() {
    assert_eq!(rates(250_000), LIKELY);
    assert_eq!(rates(74_880).len(), LIKELY.len() + 1);
    assert!(rates(0).len() > LIKELY.len(), "and the first is the user's affair");
}

fn run(test: impl Future<Output = ()>) {
    tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap().block_on(test);
}

fn mock() -> mock::Handle {
    mock::spawn(mock::Options::default()).unwrap()
}

#[test]
fn a_mock_is_asked_over_a_real_terminal() {
    run(async {
        let mock = mock();
        let path = mock.path().to_string_lossy().into_owned();
        let wanted = Wanted::Path(path.clone());
        let none = Machine::new().places();
        let mode = OpenMode::TakeOver;
        let found = connect(&wanted, Rate::Auto { first: 250_000 }, mode, 0, &none).await.unwrap();
        assert_eq!((found.port.baud(), found.awake), (250_000, true));
        drop(found);
        let found = connect(&wanted, Rate::Given(115_200), mode, 0, &none).await.unwrap();
        assert_eq!((found.port.baud(), found.awake), (115_200, false));
        // It is held now: nobody else is let in, and told so.
        let told = connect(&wanted, Rate::Auto { first: 250_000 }, mode, 0, &none).await.unwrap_err();
        assert!(told.to_string().contains("another program holds it"), "{told}");
    });
}

/// `auto` takes the only printer that answers among the ports that may be one.
#[test]
fn auto_takes_the_only_one_that_answers() {
    run(async {
        let machine = Machine::new();
        let places = machine.places();
        let auto = |rate| connect(&Wanted::Auto, rate, OpenMode::TakeOver, 0, &places);
        let given = Rate::Given(250_000);
        let told = auto(given).await.unwrap_err().to_string();
        assert!(told.contains("no USB serial port at all"), "{told}");

        let (one, two) = (mock(), mock());
        let plug = |name: &str, socket: &str, to: &Path| {
            machine.plug(name, socket, "1a86:7523", "-");
            fs::remove_file(machine.node(name)).unwrap();
            symlink(to, machine.node(name)).unwrap();
        };
        plug("ttyUSB0", "1-1", Path::new("/dev/null"));
        plug("ttyUSB1", "1-2", one.path());
        let found = auto(given).await.unwrap();
        assert_eq!(found.port.path(), machine.node("ttyUSB1"));
        assert!(found.awake && found.firmware.is_some_and(|name| name.contains("Marlin")));
        drop(found.port);

        plug("ttyUSB2", "1-3", two.path());
        let told = auto(given).await.unwrap_err().to_string();
        assert!(told.contains("auto is more than one") && told.contains("ttyUSB2"), "{told}");
    });
}

/// A port that comes back is found and opened; until then nothing ends the wait.
#[test]
fn a_vanished_port_is_taken_again() {
    run(async {
        let folder = tempfile::tempdir().unwrap();
        let link = folder.path().join("printer");
        let options = || mock::Options { link: Some(link.clone()), ..mock::Options::default() };
        let places = Machine::new().places();
        let first = mock::spawn(options()).unwrap();
        let path = link.to_string_lossy().into_owned();
        let mut port = Port::open(&path, 250_000).unwrap();
        let identity = Identity::of(&path, &places);
        first.stop().unwrap();
        let mut input = [0; 256];
        while port.exchange(&mut input, b"").await.is_ok() {}
        drop(port);
        let waiting = tokio::time::timeout(Duration::from_millis(300), wait_for(&identity, &places));
        assert!(waiting.await.is_err(), "nothing is there");

        let second = tokio::time::timeout(Duration::from_secs(60), async {
            let second = mock::spawn(options()).unwrap();
            reopen(&identity, 250_000, &places).await.unwrap();
            second
        });
        drop(second.await.expect("it is back"));
    });
}
