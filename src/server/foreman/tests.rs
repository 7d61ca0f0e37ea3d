//! The foreman by its messages: no thread, no printer, a folder of its own.
use super::*;
use crate::job::state::State;
use crate::server::config::OnFindings;
use crate::server::inspect::{Done, Work};
use crate::server::model::{Check, CheckState, Kind, Mend, MendState, Printed, Stage};
use crate::server::model::{Finding, Severity};
use crate::server::shelf::new_id;
use std::io::Write;
use tokio::sync::mpsc::Receiver;

/// A foreman with one printer, and everybody that it talks to.
struct Desk {
    foreman: Foreman,
    orders: Receiver<Order>,
    works: mpsc::Receiver<Work>,
    inbox: mpsc::Receiver<Message>,
    view: Arc<View>,
    folder: tempfile::TempDir,
}

fn printer(on_findings: OnFindings) -> config::Printer {
    config::Printer { on_findings, ..config::Printer::new("p", "generic-marlin", "/dev/null") }
}

impl Desk {
    fn new(on_findings: OnFindings) -> Self {
        Self::over(tempfile::tempdir().unwrap(), on_findings)
    }

    /// A foreman over a folder that another may have used before.
    fn over(folder: tempfile::TempDir, on_findings: OnFindings) -> Self {
        Self::of(folder, on_findings, Wants::default())
    }

    fn of(folder: tempfile::TempDir, on_findings: OnFindings, wants: Wants) -> Self {
        let shelf = Shelf::open(folder.path()).unwrap();
        let (work, works) = mpsc::channel();
        let (post, inbox) = mpsc::channel();
        let view = Arc::new(View::default());
        let means = Means {
            shelf: shelf.clone(),
            folder: Folder::open(Some(folder.path())).unwrap(),
            work,
            post,
            view: Arc::clone(&view),
            guards: false,
            keep_bytes: 1000,
        };
        let found = shelf.read();
        let mut foreman = Foreman::new(means, found.files, found.jobs);
        let (handle, orders) = Handle::fake();
        foreman.place(printer(on_findings), wants, handle);
        foreman.begin();
        Self { foreman, orders, works, inbox, view, folder }
    }

    /// The daemon dies and begins anew.
    fn again(self, on_findings: OnFindings) -> Self {
        let Self { foreman, folder, .. } = self;
        drop(foreman);
        Self::over(folder, on_findings)
    }

    fn hear(&mut self, message: Message) {
        self.foreman.hear(message);
        self.foreman.advance();
    }

    fn upload(&mut self, text: &str) -> String {
        let mut upload = self.foreman.means.shelf.upload().unwrap();
        upload.write_all(text.as_bytes()).unwrap();
        let bytes = text.len() as u64;
        let file = File { id: new_id('F').unwrap(), name: "part.gcode".to_owned(), bytes, ..File::default() };
        let (answer, mut told) = oneshot::channel();
        let id = file.id.clone();
        self.hear(Message::Uploaded { upload, file: Box::new(file), printer: None, answer });
        told.try_recv().unwrap().unwrap();
        id
    }

    fn queue(&mut self, file: &str, hold: bool) -> Result<String, Refusal> {
        let (answer, mut told) = oneshot::channel();
        let (file, printer, by) = (file.to_owned(), "p".to_owned(), "anna".to_owned());
        self.hear(Message::Queue { file, printer, hold, by, answer });
        told.try_recv().unwrap().map(|job| job.id)
    }

    fn act(&mut self, job: &str, what: Can) -> Result<Job, Refusal> {
        let (answer, mut told) = oneshot::channel();
        self.hear(Message::Act { job: job.to_owned(), what, by: "anna".to_owned(), answer });
        told.try_recv().unwrap()
    }

    /// The inspector has found something, or nothing.
    fn looked(&mut self, file: &str, state: CheckState) {
        let finding = Finding { severity: Severity::Stop, ..Finding::default() };
        let check = Check { state, findings: vec![finding], ..Check::default() };
        let (file, printer) = (file.to_owned(), "p".to_owned());
        self.hear(Message::Done(Done::Looked { file, printer, kind: Kind::Gcode, check: Box::new(check) }));
    }

    /// A person says that the bed is clear, or that all is so that the printer may begin.
    fn word(&mut self) -> Result<(), Refusal> {
        let (answer, mut told) = oneshot::channel();
        self.hear(Message::BedClear { printer: "p".to_owned(), answer });
        told.try_recv().unwrap()
    }

    fn told(&mut self, told: Told) {
        self.hear(Message::Told { printer: "p".to_owned(), told });
    }

    fn job(&self, id: &str) -> Job {
        self.view.job(id).unwrap()
    }

    fn state(&self, id: &str) -> Stage {
        self.job(id).state
    }

    /// The thread that gets a job ready has sent word.
    fn ready(&mut self) {
        let message = self.inbox.recv_timeout(std::time::Duration::from_secs(20)).unwrap();
        self.hear(message);
    }

    /// A job that a host has begun.
    fn started(&mut self, text: &str) -> String {
        let file = self.upload(text);
        let job = self.queue(&file, false).unwrap();
        self.looked(&file, CheckState::Clean);
        self.told(Told::Ready);
        self.ready();
        assert!(matches!(self.orders.try_recv(), Ok(Order::Print(_))));
        job
    }
}

const TEXT: &str = "G28\nG1 X1\n";

#[test]
fn what_was_found_holds_warns_or_mends_as_the_printer_is_set() {
    let check = |on_findings, found, expect| {
        let mut desk = Desk::new(on_findings);
        let file = desk.upload(TEXT);
        let job = desk.queue(&file, false).unwrap();
        assert_eq!(desk.state(&job), Stage::Checking);
        assert!(matches!(desk.works.try_recv(), Ok(Work::Look { .. })));
        desk.looked(&file, found);
        assert_eq!(desk.state(&job), expect, "{on_findings:?} {found:?}");
        assert_eq!(matches!(desk.works.try_recv(), Ok(Work::Mend { .. })), expect == Stage::Mending);
    };
    check(OnFindings::Hold, CheckState::Clean, Stage::Queued);
    check(OnFindings::Hold, CheckState::Found, Stage::Held);
    check(OnFindings::Hold, CheckState::Failed, Stage::Held);
    check(OnFindings::Warn, CheckState::Found, Stage::Queued);
    check(OnFindings::Warn, CheckState::Failed, Stage::Queued);
    check(OnFindings::Mend, CheckState::Found, Stage::Mending);
    check(OnFindings::Mend, CheckState::Failed, Stage::Held);
    check(OnFindings::Mend, CheckState::Clean, Stage::Queued);
}

#[test]
fn a_mended_job_waits_for_a_yes_and_one_that_cannot_be_mended_is_held() {
    let mended = |state| {
        let mut desk = Desk::new(OnFindings::Mend);
        let file = desk.upload(TEXT);
        let job = desk.queue(&file, false).unwrap();
        desk.looked(&file, CheckState::Found);
        let mend = Box::new(Mend { state, ..Mend::default() });
        desk.hear(Message::Done(Done::Mended { job: job.clone(), mend }));
        (desk, job)
    };
    let (mut desk, job) = mended(MendState::Done);
    assert_eq!(desk.state(&job), Stage::Mended);
    assert!(desk.act(&job, Can::Mend).is_err());
    let yes = desk.act(&job, Can::Approve).unwrap();
    assert_eq!((yes.state, yes.printed), (Stage::Queued, Printed::Mended));
    let (mut desk, job) = mended(MendState::Done);
    let no = desk.act(&job, Can::Original).unwrap();
    assert_eq!((no.state, no.printed), (Stage::Queued, Printed::Original));
    let (desk, job) = mended(MendState::Failed);
    assert_eq!(desk.state(&job), Stage::Held);
}

#[test]
fn a_person_can_have_any_job_held() {
    let mut desk = Desk::new(OnFindings::Warn);
    let file = desk.upload(TEXT);
    let job = desk.queue(&file, true).unwrap();
    desk.looked(&file, CheckState::Clean);
    assert_eq!(desk.state(&job), Stage::Held);
    desk.told(Told::Ready);
    assert!(desk.orders.try_recv().is_err(), "nothing moves before a yes");
    desk.act(&job, Can::Approve).unwrap();
    desk.ready();
    assert!(matches!(desk.orders.try_recv(), Ok(Order::Print(_))));
}

#[test]
fn the_next_job_waits_for_a_clear_bed() {
    let mut desk = Desk::new(OnFindings::Hold);
    let first = desk.started(TEXT);
    assert_eq!(desk.state(&first), Stage::Starting);
    desk.told(Told::Job(first.clone(), State::Printing));
    let file = desk.view.files()[0].id.clone();
    let second = desk.queue(&file, false).unwrap();
    assert_eq!(desk.job(&second).waits_for.as_deref(), Some("the job that is printed"));
    desk.told(Told::Job(first.clone(), State::Finished));
    let over = Told::Over { job: first.clone(), state: State::Finished, words: None, safety: None };
    desk.told(over);
    desk.told(Told::Ready);
    assert!(desk.inbox.try_recv().is_err(), "the bed was not said to be clear");
    assert!(!desk.view.place("p").bed_clear);
    desk.word().unwrap();
    assert!(desk.view.place("p").bed_clear);
    desk.ready();
    assert_eq!(desk.state(&second), Stage::Starting);
}

#[test]
fn what_a_person_must_have_seen_to_is_asked_for_before_each_start() {
    let wants = Wants { before: vec!["the vat is full".to_owned()], ..Wants::default() };
    let mut desk = Desk::of(tempfile::tempdir().unwrap(), OnFindings::Hold, wants);
    let file = desk.upload(TEXT);
    // Said before there is a job, it is for none.
    desk.word().unwrap();
    let job = desk.queue(&file, false).unwrap();
    desk.looked(&file, CheckState::Clean);
    assert!(desk.word().is_err(), "nobody knows how the printer will be when it is switched on");
    desk.told(Told::Ready);
    assert_eq!(desk.job(&job).waits_for.as_deref(), Some("your word that the vat is full"));
    assert!(desk.inbox.try_recv().is_err());
    desk.word().unwrap();
    assert!(desk.job(&job).prepared);
    desk.ready();
    assert_eq!((desk.state(&job), desk.job(&job).prepared), (Stage::Starting, false));
    desk.told(Told::Job(job.clone(), State::Printing));
    let next = desk.queue(&file, false).unwrap();
    assert!(desk.word().is_err(), "what is seen to while it prints is not what will be");
    desk.told(Told::Job(job.clone(), State::Finished));
    desk.told(Told::Over { job, state: State::Finished, words: None, safety: None });
    desk.told(Told::Ready);
    assert_eq!(desk.state(&next), Stage::Queued, "each start wants its own word");
    desk.act(&next, Can::Start).unwrap();
    desk.ready();
    assert_eq!(desk.state(&next), Stage::Starting);
}

#[test]
fn what_was_seen_to_does_not_outlast_the_connection() {
    let wants = Wants { before: vec!["the vat is full".to_owned()], ..Wants::default() };
    let mut desk = Desk::of(tempfile::tempdir().unwrap(), OnFindings::Hold, wants);
    let file = desk.upload(TEXT);
    let job = desk.queue(&file, false).unwrap();
    desk.looked(&file, CheckState::Clean);
    desk.told(Told::Ready);
    desk.word().unwrap();
    // The printer goes before the job was got ready for it, and with it what was said of it.
    let message = desk.inbox.recv_timeout(std::time::Duration::from_secs(20)).unwrap();
    desk.told(Told::Away);
    drop(message);
    assert_eq!((desk.state(&job), desk.job(&job).prepared), (Stage::Queued, false));
}

#[test]
fn a_job_that_came_too_late_waits_on_and_is_begun_once() {
    let mut desk = Desk::new(OnFindings::Hold);
    let job = desk.started(TEXT);
    let over =
        Told::Over { job: job.clone(), state: State::Accepted, words: Some("gone".to_owned()), safety: None };
    desk.told(over);
    let now = desk.job(&job);
    assert_eq!((now.state, now.error.as_deref(), now.record), (Stage::Queued, Some("gone"), None));
    assert!(desk.orders.try_recv().is_err(), "not before the printer is there again");
    desk.told(Told::Ready);
    desk.ready();
    assert!(matches!(desk.orders.try_recv(), Ok(Order::Print(_))));
}

#[test]
fn a_file_that_cannot_be_printed_fails_with_a_reason() {
    let mut desk = Desk::new(OnFindings::Warn);
    let file = desk.upload("; nothing in it\n");
    let job = desk.queue(&file, false).unwrap();
    desk.looked(&file, CheckState::Failed);
    desk.told(Told::Ready);
    desk.ready();
    let failed = desk.job(&job);
    assert_eq!(failed.state, Stage::Failed);
    assert!(failed.error.is_some_and(|why| !why.is_empty()));
    // A resin job is none for a printer that melts filament.
    let file = desk.upload(TEXT);
    let job = desk.queue(&file, false).unwrap();
    let check = Box::new(Check { state: CheckState::Clean, ..Check::default() });
    desk.hear(Message::Done(Done::Looked { file, printer: "p".to_owned(), kind: Kind::Resin, check }));
    assert_eq!(desk.state(&job), Stage::Failed);
}

#[test]
fn what_was_accepted_is_there_after_a_restart() {
    let mut desk = Desk::new(OnFindings::Hold);
    let file = desk.upload(TEXT);
    let held = desk.queue(&file, true).unwrap();
    desk.looked(&file, CheckState::Clean);
    let waiting = desk.queue(&file, false).unwrap();
    let other = desk.upload("G28\n");
    let checking = desk.queue(&other, false).unwrap();
    let mut desk = desk.again(OnFindings::Hold);
    assert_eq!(
        [&held, &waiting, &checking].map(|id| desk.state(id)),
        [Stage::Held, Stage::Queued, Stage::Checking]
    );
    // What was not looked at to the end is looked at again.
    assert!(matches!(desk.works.try_recv(), Ok(Work::Look { file, .. }) if file == other));
    assert_eq!(desk.view.place("p").queue, [held, waiting, checking.clone()]);
    desk.looked(&other, CheckState::Clean);
    assert_eq!(desk.state(&checking), Stage::Queued);
}

#[test]
fn a_job_that_a_dead_daemon_had_taken_and_not_begun_waits_again() {
    let mut desk = Desk::new(OnFindings::Hold);
    let job = desk.started(TEXT);
    // Its journal says that nothing was sent.
    let mut desk = desk.again(OnFindings::Hold);
    assert_eq!(desk.state(&job), Stage::Queued);
    desk.told(Told::Ready);
    desk.ready();
    assert!(matches!(desk.orders.try_recv(), Ok(Order::Print(_))));
    // Its journal is gone: what was printed cannot be known.
    desk.told(Told::Job(job.clone(), State::Printing));
    std::fs::remove_dir_all(desk.folder.path().join("jobs")).unwrap();
    let desk = desk.again(OnFindings::Hold);
    assert_eq!(desk.state(&job), Stage::Failed);
}

#[test]
fn a_medium_that_refuses_accepts_nothing_and_changes_nothing() {
    let mut desk = Desk::new(OnFindings::Hold);
    let file = desk.upload(TEXT);
    let job = desk.queue(&file, true).unwrap();
    desk.looked(&file, CheckState::Clean);
    let queue = desk.folder.path().join("queue");
    std::fs::rename(&queue, desk.folder.path().join("away")).unwrap();
    assert!(matches!(desk.queue(&file, false), Err(Refusal::Shelf(_))));
    assert!(matches!(desk.act(&job, Can::Approve), Err(Refusal::Shelf(_))));
    assert_eq!(desk.state(&job), Stage::Held, "what was not written down did not happen");
    std::fs::rename(desk.folder.path().join("away"), &queue).unwrap();
    desk.act(&job, Can::Approve).unwrap();
    assert_eq!(desk.state(&job), Stage::Queued);
}

#[test]
fn files_that_jobs_need_stay_and_the_oldest_others_give_way() {
    let mut desk = Desk::new(OnFindings::Hold);
    let needed = desk.upload(&"G28\n".repeat(100));
    desk.queue(&needed, true).unwrap();
    let old = desk.upload(&"G28\n".repeat(100));
    let new = desk.upload(&"G28\n".repeat(100));
    assert!(desk.view.file(&needed).is_some() && desk.view.file(&new).is_some());
    assert!(desk.view.file(&old).is_none(), "1000 bytes are kept");
    let (answer, mut told) = oneshot::channel();
    desk.hear(Message::Remove { file: needed, answer });
    assert!(matches!(told.try_recv().unwrap(), Err(Refusal::Conflict(_))));
}

#[test]
fn the_queue_is_put_into_another_order() {
    let mut desk = Desk::new(OnFindings::Hold);
    let file = desk.upload(TEXT);
    let jobs: Vec<_> = (0..4).map(|_| desk.queue(&file, true).unwrap()).collect();
    let check = |desk: &mut Desk, order: &[usize], expect: [usize; 4]| {
        let (answer, mut told) = oneshot::channel();
        let order = order.iter().map(|at| jobs[*at].clone()).collect();
        desk.hear(Message::Reorder { printer: "p".to_owned(), order, answer });
        told.try_recv().unwrap().unwrap();
        assert_eq!(desk.view.place("p").queue, expect.map(|at| jobs[at].clone()));
    };
    check(&mut desk, &[2], [2, 0, 1, 3]);
    check(&mut desk, &[3, 1, 0, 2], [3, 1, 0, 2]);
    check(&mut desk, &[], [3, 1, 0, 2]);
    let desk = desk.again(OnFindings::Hold);
    assert_eq!(desk.view.place("p").queue, [3, 1, 0, 2].map(|at: usize| jobs[at].clone()));
}
