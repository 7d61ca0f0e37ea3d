// node page.mjs BASE NAME PASSWORD JOB.gcode FOLDER
//
// A person's way through the daemon's page, against a daemon with one idle printer: a job with an island is sent, held,
// mended, looked at, printed to its end; others are paused, cancelled and stopped. Prints a line a step, puts pictures
// into FOLDER, and ends with 1 at the first step that fails.

import assert from 'node:assert/strict';
import fs from 'node:fs';
import path from 'node:path';
import { Browser, PATIENCE_MS, WIDE, measured, program } from './browser.mjs';

const [base, name, password, job, folder] = process.argv.slice(2);
const MOST_BYTES = 150_000;
// Far more than is needed where nothing else runs.
const MOST_SECONDS = 10;
const VIEWER = { name: 'vera', password: 'she only looks at it' };
// A place of the picture that is drawn has colours in more of its pixels than this.
const LEAST_COLOUR = 0.002;

if (!folder || !program()) {
  console.error(folder ? 'no Chromium: name one by CHROMIUM' : 'node page.mjs BASE NAME PASSWORD JOB.gcode FOLDER');
  process.exit(2);
}
fs.mkdirSync(folder, { recursive: true });
const browser = await Browser.start(base, folder);
const page = await browser.page();
const jobName = path.basename(job);
const began = performance.now();

/** One step, a line. What the page did wrong meanwhile counts. */
async function step(words, act) {
  try {
    const more = await act();
    if (browser.faults.length) throw new Error(browser.faults.join('\n    '));
    console.log(`ok   ${words}${more ? `: ${more}` : ''}`);
  } catch (error) {
    console.log(`FAIL ${words}: ${[error.message, ...browser.faults].join('\n    ')}`);
    console.log(`    at ${page.url()}, which says:\n${await page.evaluate(() => document.body.innerText).catch(() => 'nothing')}`);
    await browser.shot(page, 'failed').catch(() => {});
    await browser.browser.close();
    process.exit(1);
  }
}

/** The page has these words somewhere, as they are seen. */
const sees = (words, on = page) => on.waitForFunction((wanted) => document.body.innerText.toLowerCase().includes(wanted.toLowerCase()), { polling: 100 }, words);
const lacks = async (words, on = page) => assert(!(await on.evaluate(() => document.body.innerText)).toLowerCase().includes(words.toLowerCase()), `“${words}” is there`);
const named = (words, role = 'button', on = page) => on.locator(`::-p-aria([name="${words}"][role="${role}"])`);
const press = (words, on = page) => named(words, 'button', on).click();
const go = (hash, on = page) => on.evaluate((to) => { location.hash = to; }, hash);
const heading = (words, on = page) => on.waitForFunction((wanted) => document.querySelector('main h1')?.textContent === wanted, {}, words);
/** The state beside the heading. */
const state = (...words) => page.waitForFunction((wanted) => wanted.includes(document.querySelector('.view-head .pill')?.textContent), { polling: 100 }, words);
/** The figure of a name, as `Nozzle`. */
const figure = (term) => page.evaluate((wanted) => [...document.querySelectorAll('.facts > div')].find((row) => row.querySelector('dt').textContent === wanted)?.querySelector('dd').textContent, term);
const progress = () => page.$eval('.progress .bar', (bar) => Number(bar.getAttribute('aria-valuenow')));

async function logIn(on, who, word) {
  await on.locator('input[name=name]').fill(who);
  await on.locator('input[name=password]').fill(word);
  await press('Log in', on);
}

/** What is drawn in the picture's frame: its document, once its words and its canvas are there. */
async function picture() {
  const element = await page.waitForSelector('.picture iframe');
  await element.evaluate((frame) => frame.scrollIntoView({ block: 'center' }));
  const frame = await element.contentFrame();
  await frame.waitForFunction(() => document.getElementById('verdict')?.textContent, { polling: 100 });
  assert.equal(await frame.$eval('#failed', (failed) => failed.hidden || failed.textContent), true);
  const wanted = await page.evaluate(() => document.documentElement.dataset.theme);
  assert.equal(await frame.evaluate(() => document.documentElement.dataset.theme), wanted, 'the picture is as light as the page');
  const canvas = await frame.waitForSelector('#view');
  // What turns is drawn by a processor here, which takes its time.
  const until = performance.now() + PATIENCE_MS;
  let part = 0;
  while ((part = await browser.colourful(canvas)) < LEAST_COLOUR) assert(performance.now() < until, `the picture is blank (${part})`);
  return { frame, part, verdict: await frame.$eval('#verdict', (verdict) => verdict.textContent) };
}

async function confirmBed() {
  await go('#/printer/mock');
  await press('The bed is clear');
  await page.waitForFunction(() => !document.body.innerText.includes('The bed is clear'));
}

/** From the list of files into the printer, with the job's findings taken as they are. */
async function printAnyway() {
  await go('#/files');
  await press(`Print on ${printer}: ${jobName}`);
  await heading(jobName);
  await state('Held');
  await press('Print anyway');
  await state('Starting', 'Printing');
}

const kilobytes = ({ bytes, requests, seconds }) => `${(bytes / 1000).toFixed(1)} kB in ${requests} requests, ${seconds.toFixed(2)} s at 1 Mbit/s and 100 ms`;
const light = (cost) => assert(cost.bytes < MOST_BYTES && cost.seconds < MOST_SECONDS, kilobytes(cost));
let printer = null;
let jobHash = null;

await step('the first view, the log-in, over a slow link', async () => {
  const slow = await browser.page();
  const cost = await measured(slow, base, 'input[name=name]');
  light(cost);
  await slow.browserContext().close();
  return kilobytes(cost);
});

await step('the log-in looks well', async () => {
  await page.goto(base);
  await page.waitForSelector('input[name=name]');
  await browser.look(page, 'login');
});

await step('a wrong password is told', async () => {
  browser.awaited.add('401');
  await logIn(page, name, 'wrong');
  await page.waitForSelector('.form-problem:not(:empty)');
  browser.awaited.clear();
  return page.$eval('.form-problem', (problem) => problem.textContent);
});

await step('the right one shows the printers', async () => {
  await logIn(page, name, password);
  await page.waitForSelector('.tile');
  printer = await page.$eval('.tile h2', (title) => title.textContent);
  await sees('Ready');
  return printer;
});

await step('the printers, nothing kept from before, over a slow link', async () => {
  const slow = await page.browserContext().newPage();
  await slow.setViewport(WIDE);
  const cost = await measured(slow, base, '.tile');
  light(cost);
  await slow.close();
  return kilobytes(cost);
});

await step('an idle printer looks well', async () => {
  await go('#/');
  await browser.look(page, 'printers');
  await go('#/printer/mock');
  await heading(printer);
  await page.waitForFunction(() => document.querySelector('.graph path'));
  await browser.look(page, 'printer-idle');
});

await step('heat: beyond the limit is told, a preset heats, off cools', async () => {
  await page.locator('input[name=nozzle_c]').fill('999');
  await press('Set');
  await sees('at most.');
  await page.locator('input[name=nozzle_c]').fill('');
  await page.locator('button[data-key=TPU]').click();
  await page.waitForFunction(() => /\/ 225 °C/.test(document.querySelector('.now .facts').textContent));
  await press('All off');
  await page.waitForFunction(() => !document.querySelector('.now .facts').textContent.includes('/'));
});

await step('jog: home and a step by the arrow key', async () => {
  await page.locator('button[data-key="home all"]').click();
  await page.waitForFunction(() => /sentG28/.test(document.querySelector('.log').textContent));
  await page.focus('button[data-key="x1"]');
  await page.keyboard.press('ArrowRight');
  await page.waitForFunction(() => /sentG[01] X10/.test(document.querySelector('.log').textContent));
});

await step('console: a command and what the printer says to it', async () => {
  await page.locator('input[aria-label=Command]').fill('M503');
  await page.keyboard.press('Enter');
  await page.waitForFunction(() => document.querySelector('.log').textContent.includes('Unknown command: "M503"'));
});

await step('console: what is fetched and streamed is not said twice', () => page.evaluate(async () => {
  const { unseen } = await import('/assets/console.js');
  const lines = (words) => [...words].map((text) => ({ at_unix_s: 1, from: 'printer', text }));
  const words = (some) => some.map(({ text }) => text).join('');
  // Streamed in two goes, after these were fetched: what is new of each.
  for (const [fetched, first, then, expect] of [['abc', 'bcd', 'e', 'd,e'], ['abcd', 'bc', 'de', ',e'], ['abc', 'd', 'c', 'd,c'], ['', 'a', 'a', 'a,a'], ['aab', 'ab', 'b', ',b']]) {
    const [one, rest] = unseen(lines(first), lines(fetched));
    const [two] = unseen(lines(then), rest);
    if (`${words(one)},${words(two)}` !== expect) throw new Error(`${fetched} ${first} ${then}: ${words(one)},${words(two)}`);
  }
}));

await step(`${jobName} is sent by the page's own file input, and held`, async () => {
  const [chooser] = await Promise.all([page.waitForFileChooser(), press('Send a file…')]);
  await chooser.accept([job]);
  await sees('A job waits for your decision');
  await browser.axe(page, 'printer with a held job');
  await named('See the job', 'link').click();
  await heading(jobName);
  await state('Held');
  jobHash = new URL(page.url()).hash;
});

await step('its findings are told in words', async () => {
  await sees('1 island begins in the air');
  const findings = await page.$$eval('.finding', (list) => list.map((one) => one.innerText.replace(/\s+/g, ' ')));
  assert(findings.some((words) => /^Would fail A piece begins in the air at Z \d/i.test(words)), findings.join('\n'));
  for (const words of findings) assert.equal((words.match(/layer \d+/g) ?? []).length, 1, `a place is told once: ${words}`);
  return findings.join(' / ');
});

await step('its picture shows the island', async () => {
  const { frame, part, verdict } = await picture();
  assert.match(verdict, /1 island/i);
  assert.match(await frame.$eval('#where', (where) => where.textContent), /Layer \d+ of \d+/);
  return `“${verdict}”, ${(part * 100).toFixed(1)} % of it coloured`;
});

await step('a held job looks well', () => browser.look(page, 'job-held', picture));

await step('Mend it: mended, with the picture of it', async () => {
  await press('Mend it');
  await state('Mended');
  await sees('Print the mended job');
  const { part, verdict } = await picture();
  const words = await page.$eval('.decide .large', (large) => large.textContent);
  return `“${words}”; picture: “${verdict}”, ${(part * 100).toFixed(1)} % of it coloured`;
});

await step('the other pictures can be chosen', async () => {
  for (const choice of ['Before: as sliced', 'After: mended']) {
    await named(choice, 'radio').click();
    await picture();
  }
  if (await page.$('.segments input[aria-label="Paths before and after"]')) await named('Paths before and after', 'radio').click();
});

await step('a mended job looks well', () => browser.look(page, 'job-mended', picture));

await step('approved on the picture, it prints: temperatures and progress move', async () => {
  await press('Print the mended job');
  await state('Starting', 'Printing');
  await page.waitForFunction(() => /\/ 210 °C/.test(document.querySelector('.facts').textContent));
  await state('Printing');
  const seen = [await progress()];
  while (seen.length < 3) {
    await page.waitForFunction((last) => Number(document.querySelector('.progress .bar').getAttribute('aria-valuenow')) > last, { polling: 100 }, seen.at(-1));
    seen.push(await progress());
  }
  return `${seen.join(', ')} %; nozzle ${await figure('Nozzle')}, layer ${await figure('Layer')}, ${await figure('Time left')} left`;
});

await step('a printer at work looks well', async () => {
  await go('#/printer/mock');
  await state('Printing');
  await browser.look(page, 'printer-printing');
});

await step('it ends', async () => {
  await go(jobHash);
  await state('Finished');
  await sees('mended');
  await browser.look(page, 'job-finished');
});

await step('the bed is clear', confirmBed);

await step('a second one: paused and resumed', async () => {
  await printAnyway();
  await state('Printing');
  await page.waitForFunction(() => Number(document.querySelector('.progress .bar').getAttribute('aria-valuenow')) > 0);
  await press('Pause');
  await state('Paused');
  const at = await progress();
  await go('#/printer/mock');
  await state('Paused');
  await browser.axe(page, 'printer paused');
  await press('Resume');
  await state('Printing');
  await page.waitForFunction((last) => Number(document.querySelector('.progress .bar').getAttribute('aria-valuenow')) > last, { polling: 100 }, at);
});

await step('cancel asks in its place, and takes a no', async () => {
  await press('Cancel…');
  await sees('It cannot be taken up again');
  assert.equal(await page.evaluate(() => document.activeElement.textContent), 'No, keep it');
  await browser.shot(page, 'cancel-asked');
  await page.keyboard.press('Escape');
  await lacks('It cannot be taken up again');
  await press('Cancel…');
  await press('Yes, cancel it');
  await state('Ready');
  await sees('Cancelled');
});

await step('emergency stop, one press, with a dialog open', async () => {
  await confirmBed();
  await printAnyway();
  await state('Printing');
  const hash = new URL(page.url()).hash;
  await page.evaluate(() => document.activeElement.blur());
  await page.keyboard.press('?');
  await page.waitForSelector('.dialog');
  await browser.axe(page, 'dialog of keys');
  await browser.shot(page, 'dialog-keys');
  await page.locator('.estop').click();
  await sees(`Emergency stop sent to ${printer}`);
  await page.keyboard.press('Escape');
  await go(hash);
  await state('Broken off');
  await sees('Emergency stop; the firmware has switched its heaters off');
  await browser.look(page, 'job-stopped');
});

await step('the printer comes back; the job that was stopped is given up, and forgotten', async () => {
  const hash = new URL(page.url()).hash;
  await go('#/printer/mock');
  await state('Ready');
  await browser.look(page, 'printer-stopped');
  await press('Give it up…');
  await press('Yes, give it up');
  await page.waitForFunction(() => !document.body.innerText.includes('A print was broken off'));
  await go(hash);
  await state('Cancelled');
  await press('Forget…');
  await press('Yes, forget it');
  await heading(printer);
  await page.waitForFunction(() => !document.body.innerText.includes('A print was broken off'));
});

await step('the files look well', async () => {
  await go('#/files');
  await heading('Files');
  await browser.look(page, 'files');
  await page.locator('input[type=search]').fill('nothing of the kind');
  await sees('No file has that in its name');
  await page.locator('input[type=search]').fill('lamp');
  await named(`Print on ${printer}: ${jobName}`).wait();
});

await step('users: the password is asked again, a wrong one is told, a viewer is made', async () => {
  await go('#/settings');
  await heading('Settings');
  // Whoever logged in within ten minutes is not asked; so the daemon's answer after those is given once in its stead.
  let late = true;
  const answer = (request) => {
    const isUsers = late && new URL(request.url()).pathname === '/api/v2/users';
    if (!isUsers) return request.continue();
    late = false;
    const body = { type: 'https://outrigger.invalid/problems/reauthenticate', title: 'Give your password once more', status: 403 };
    return request.respond({ status: 403, contentType: 'application/problem+json', body: JSON.stringify(body) });
  };
  await page.setRequestInterception(true);
  page.on('request', answer);
  browser.awaited.add('401').add('403');
  await press('Show: Users');
  await page.waitForSelector('.dialog input[type=password]');
  await browser.axe(page, 'dialog of the password');
  await browser.shot(page, 'dialog-password');
  await page.locator('.dialog input').fill('wrong');
  await page.keyboard.press('Enter');
  await page.waitForSelector('.dialog .form-problem:not(:empty)');
  await page.locator('.dialog input').fill(password);
  await page.keyboard.press('Enter');
  await page.waitForFunction(() => !document.querySelector('.dialog'));
  browser.awaited.clear();
  page.off('request', answer);
  await page.setRequestInterception(false);
  await page.locator('summary ::-p-text(Add a user)').click();
  const [who, word] = await page.$$('details[open] form input');
  await who.type(VIEWER.name);
  await word.type(VIEWER.password);
  await page.keyboard.press('Enter');
  await sees(`${VIEWER.name} was added`);
});

await step('keys: one is made, shown once, and deleted', async () => {
  await press('Show: API keys');
  await page.locator('summary ::-p-text(Make a key)').click();
  await page.locator('details[open] form input:not([type=checkbox])').fill('a slicer');
  await press('Make the key');
  await sees('Your new key');
  const key = await page.$eval('.box.good input', (input) => input.value);
  assert.match(key, /^\S{20,}$/);
  await browser.look(page, 'settings');
  await press('I have it');
  await page.waitForFunction(() => !document.querySelector('.box.good'));
  assert(!(await page.content()).includes(key), 'the key is still in the page');
  const row = (await page.$$('.rows > li')).at(-1);
  await (await row.$('button')).click();
  await press('Yes, delete it');
  await sees('The key is deleted');
});

await step('a viewer sees all, and no button that it may not use', async () => {
  const viewer = await browser.page();
  await viewer.goto(base);
  await logIn(viewer, VIEWER.name, VIEWER.password);
  await viewer.waitForSelector('.tile');
  const mayPress = ['To the content', '◐', '?', 'Log out', 'Light or dark'];
  for (const [hash, title] of [['#/', 'Printers'], ['#/printer/mock', printer], [jobHash, jobName], ['#/files', 'Files'], ['#/settings', 'Settings']]) {
    await go(hash, viewer);
    await heading(title, viewer);
    await viewer.waitForNetworkIdle({ idleTime: 200 });
    const buttons = await viewer.$$eval('button', (list) => list.map((one) => one.textContent));
    assert.deepEqual(buttons.filter((words) => !mayPress.includes(words)), [], hash);
    await browser.axe(viewer, `viewer ${hash}`);
  }
  await go('#/printer/mock', viewer);
  await sees('may look, not print', viewer);
  await browser.shot(viewer, 'viewer-printer');
  await viewer.browserContext().close();
});

await step('light or dark, as pressed, goes for the picture too', async () => {
  await go(jobHash);
  await picture();
  await press('Light or dark');
  await page.waitForFunction(() => document.documentElement.dataset.theme === 'dark');
  await page.waitForFunction(() => document.querySelector('.picture iframe').src.includes('dark'));
  await picture();
  await press('Light or dark');
  await page.waitForFunction(() => document.documentElement.dataset.theme === 'light');
});

await step('an address of nothing says so; logged out, the log-in is back', async () => {
  await go('#/nothing');
  await sees('Nothing is here');
  await browser.axe(page, 'nothing');
  await go('#/settings');
  await press('Log out');
  await page.waitForSelector('input[name=name]');
});

console.log(`all of it in ${((performance.now() - began) / 1000).toFixed(0)} s, ${browser.looked} looks of axe without a finding`);
await browser.browser.close();
