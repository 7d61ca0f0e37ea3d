//! `outrigger ports`: the serial ports that there are, and which have a printer.
use super::{print::runtime, say};
use crate::printer::find::baud::{Verdict, rates};
use crate::printer::find::{self, Found, Places, Usb};
use crate::printer::port::{OpenMode, PortError};
use crate::printer::session::DEFAULT_BOOT_WAIT_MS;
use crate::station::escape::printable;
use anyhow::bail;
use serde_json::{Value, json};
use std::io::ErrorKind;
use std::path::Path;
use std::process::ExitCode;

/// The speed that most printers have: asked first.
const FIRST_BAUD: u32 = 115_200;

/// List the serial ports: what is plugged in, and what to write for --port.
///
/// Without --probe no port is opened and nothing is sent.
#[derive(clap::Args)]
pub(super) struct Args {
    /// Only these devices; they may also be links or pseudo-terminals.
    #[arg(value_name = "DEV")]
    only: Vec<String>,
    /// Open each port and ask for a printer at the likely speeds. Opening resets
    /// many boards: whatever they were doing is lost, except on ports that another
    /// program holds. Takes up to 20 seconds.
    #[arg(long)]
    probe: bool,
    /// Write JSON: `ports`, each with `path`, `port` (what to write for --port),
    /// `may_be_printer`, `by_id`, `usb`, and after --probe `printer`.
    #[arg(long)]
    json: bool,
}

/// Runs the verb. See [`Args`].
///
/// # Errors
/// A device that was named is not there.
pub(super) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let all = find::scan(&Places::default());
    let chosen = chosen(&all, &args.only)?;
    let asked = match args.probe {
        true => runtime()?.block_on(probe(&chosen, !args.only.is_empty())),
        false => vec![None; chosen.len()],
    };
    let rows: Vec<Row> = chosen
        .into_iter()
        .zip(asked)
        .map(|(port, asked)| Row { handle: port.handle(&all), port, asked })
        .collect();
    if args.json {
        let ports: Vec<Value> = rows.iter().map(Row::json).collect();
        say(&format!("{:#}", json!({ "ports": ports })));
    } else if rows.is_empty() {
        eprintln!("outrigger: no serial port is there; is the printer plugged in and switched on?");
    } else {
        say(&table(&rows));
    }
    Ok(ExitCode::SUCCESS)
}

/// What came of asking a port.
#[derive(Debug, Clone)]
enum Asked {
    Heard(Verdict),
    Held,
    Failed(String),
}

struct Row {
    port: Found,
    handle: String,
    /// `None`: was not asked.
    asked: Option<Asked>,
}

/// The ports to list: all, or those that were named.
fn chosen(all: &[Found], only: &[String]) -> anyhow::Result<Vec<Found>> {
    if only.is_empty() {
        return Ok(all.to_vec());
    }
    let named = |path: &String| {
        if !Path::new(path).exists() {
            bail!("there is no {}; `outrigger ports` lists what there is", printable(path));
        }
        let known = all.iter().find(|port| port.path == *path || port.by_id.as_ref() == Some(path));
        Ok(known.cloned().unwrap_or_else(|| Found { path: path.clone(), by_id: None, usb: None }))
    };
    only.iter().map(named).collect()
}

/// Asks the ports that may have a printer (or all), at once.
async fn probe(ports: &[Found], all: bool) -> Vec<Option<Asked>> {
    let mut asked = vec![None; ports.len()];
    let mut tasks = tokio::task::JoinSet::new();
    for (at, port) in ports.iter().enumerate().filter(|(_, port)| all || port.may_be_printer()) {
        let path = port.path.clone();
        tasks.spawn(async move {
            let rates = rates(FIRST_BAUD);
            let probed = find::probe(&path, rates, OpenMode::TakeOver, DEFAULT_BOOT_WAIT_MS, true).await;
            let heard = match probed {
                Ok(probed) => Asked::Heard(probed.verdict),
                Err(PortError::Open { kind: ErrorKind::ResourceBusy, .. }) => Asked::Held,
                Err(e) => Asked::Failed(e.to_string()),
            };
            (at, heard)
        });
    }
    while let Some(done) = tasks.join_next().await {
        if let Ok((at, heard)) = done {
            asked[at] = Some(heard);
        }
    }
    asked
}

impl Row {
    fn json(&self) -> Value {
        let usb = self.port.usb.as_ref().map(|usb| {
            json!({
                "vendor_id": format!("{:04x}", usb.vendor), "product_id": format!("{:04x}", usb.product),
                "serial_number": usb.serial, "manufacturer": usb.manufacturer,
                "product": usb.product_name, "location": usb.location,
            })
        });
        let mut row = json!({
            "path": self.port.path, "port": self.handle, "by_id": self.port.by_id,
            "may_be_printer": self.port.may_be_printer(), "usb": usb,
        });
        if let Some(asked) = &self.asked {
            row["printer"] = match asked {
                Asked::Heard(Verdict::Speaks { baud, firmware }) => {
                    json!({ "found": "printer", "baud": baud, "firmware": firmware })
                }
                Asked::Heard(Verdict::Noise) => json!({ "found": "noise" }),
                Asked::Heard(Verdict::Silence) => json!({ "found": "silence" }),
                Asked::Held => json!({ "found": "in_use" }),
                Asked::Failed(error) => json!({ "found": "error", "error": error }),
            };
        }
        row
    }

    fn cells(&self) -> [String; 4] {
        let usb = self.port.usb.as_ref();
        let ids = usb.map(|usb| format!("{:04x}:{:04x}", usb.vendor, usb.product)).unwrap_or_default();
        [self.port.path.clone(), self.handle.clone(), ids, self.device()].map(|cell| printable(&cell))
    }

    /// What it calls itself, and what answered.
    fn device(&self) -> String {
        let mut words = Vec::new();
        if let Some(Usb { manufacturer, product_name, serial, .. }) = &self.port.usb {
            words.extend([manufacturer.clone(), product_name.clone()].into_iter().flatten());
            words.extend(serial.as_ref().map(|serial| format!("(serial number {serial})")));
        }
        let mut told = words.join(" ");
        let answer = match &self.asked {
            None => return told,
            Some(Asked::Heard(Verdict::Speaks { baud, firmware })) => {
                format!("{} at {baud} baud", firmware.as_deref().unwrap_or("a printer without a name"))
            }
            Some(Asked::Heard(Verdict::Noise)) => "sends what cannot be read at any likely speed".to_owned(),
            Some(Asked::Heard(Verdict::Silence)) => "silent".to_owned(),
            Some(Asked::Held) => "held by another program".to_owned(),
            Some(Asked::Failed(error)) => error.clone(),
        };
        if !told.is_empty() {
            told.push_str(": ");
        }
        told + &answer
    }
}

fn table(rows: &[Row]) -> String {
    let heads = ["PORT", "--port", "USB", "DEVICE"].map(str::to_owned);
    let lines: Vec<[String; 4]> = std::iter::once(heads).chain(rows.iter().map(Row::cells)).collect();
    let wide = |column: usize| lines.iter().map(|line| line[column].chars().count()).max().unwrap_or(0);
    let widths = [wide(0), wide(1), wide(2)];
    let line = |cells: &[String; 4]| {
        let [port, handle, ids, device] = cells;
        let [a, b, c] = widths;
        format!("{port:a$}  {handle:b$}  {ids:c$}  {device}").trim_end().to_owned()
    };
    lines.iter().map(line).collect::<Vec<_>>().join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(asked: Option<Asked>) -> Row {
        let usb = Usb {
            vendor: 0x1a86,
            product: 0x7523,
            product_name: Some("USB\u{1b}[2J Serial".into()),
            location: "1-1".into(),
            ..Usb::default()
        };
        let port = Found { path: "/dev/ttyUSB0".into(), by_id: None, usb: Some(usb) };
        Row { handle: "/dev/ttyUSB0".into(), port, asked }
    }

    #[test]
    fn a_table_says_what_is_there_and_acts_on_no_terminal() {
        let check = |asked, expect: &str| {
            let table = table(&[row(asked)]);
            let (head, line) = table.split_once('\n').unwrap();
            assert_eq!(head, "PORT          --port        USB        DEVICE");
            assert_eq!(
                line,
                format!("/dev/ttyUSB0  /dev/ttyUSB0  1a86:7523  USB\\u{{1b}}[2J Serial{expect}")
            );
        };
        check(None, "");
        check(Some(Asked::Heard(Verdict::Silence)), ": silent");
        let firmware = Some("Marlin\u{7}".to_owned());
        check(
            Some(Asked::Heard(Verdict::Speaks { baud: 250_000, firmware })),
            ": Marlin\\u{7} at 250000 baud",
        );
        check(Some(Asked::Held), ": held by another program");
    }

    #[test]
    fn json_has_the_documented_fields() {
        let check = |asked, expect: Value| assert_eq!(row(asked).json().get("printer"), Some(&expect));
        check(
            Some(Asked::Heard(Verdict::Speaks { baud: 250_000, firmware: None })),
            json!({ "found": "printer", "baud": 250_000, "firmware": null }),
        );
        check(Some(Asked::Held), json!({ "found": "in_use" }));
        check(Some(Asked::Failed("no".into())), json!({ "found": "error", "error": "no" }));
        let plain = row(None).json();
        assert_eq!(plain.get("printer"), None);
        assert_eq!(plain["usb"]["vendor_id"], "1a86");
        assert_eq!(plain["may_be_printer"], true);
    }
}
