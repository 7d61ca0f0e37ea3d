//! Where a job that was broken off stands, and the way back into it, in plain words.
use crate::job::recover::{Case, Plan};
use crate::station::escape::printable;

/// What a person is told of a job that was broken off.
pub(crate) fn words(case: &Case) -> String {
    match case {
        Case::NotBegun => "nothing of the file was sent yet: it starts at its first line".to_owned(),
        Case::HostDied { after, parked } => {
            let goes_on = match parked {
                true => "it was parked, and waits for you",
                false => "the print goes on where it is, every line once",
            };
            format!(
                "only the host had died: the printer kept its state and has accepted {after} commands of the \
                 file; {goes_on}"
            )
        }
        Case::PrinterReset { after, exact } => {
            let how = match exact {
                true => "it had made exactly these, and goes on after them",
                false => "it goes on some moves before that, so that nothing is left out",
            };
            format!(
                "the printer was reset or had lost its power, and no longer knows where its head is. {after} \
                 commands of the file were acknowledged; {how}"
            )
        }
        Case::Refused(why) => {
            format!("the printer was reset or had lost its power, and this job cannot be resumed: {why}")
        }
        Case::NotKnown { certain, uncertain } => {
            format!("certain: {}. Not certain: {}", printable(certain), printable(uncertain))
        }
        Case::Unsafe => "it was being ended when its host died: that is done first".to_owned(),
        Case::Over => "the job is over".to_owned(),
    }
}

/// The way back, step by step, with the lines that are sent.
pub(crate) fn plan(plan: &Plan) -> String {
    let what = if plan.of_plate { "plate" } else { "nozzle" };
    let mut text = format!("the way back, with the {what} taken to be at Z {:.2} mm:\n", plan.z_mm);
    for (at, step) in plan.steps.iter().enumerate() {
        let lines: Vec<_> = step.lines.iter().map(|line| printable(line)).collect();
        text += &format!("  {:>2}. {} ({})\n", at + 1, printable(&step.what), lines.join("; "));
    }
    if !plan.of_plate {
        text += &format!(
            "  then the file goes on after {} of its commands; at most {} moves are made twice",
            plan.after, plan.most_twice
        );
    }
    text
}
