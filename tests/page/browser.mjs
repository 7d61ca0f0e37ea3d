// A browser for the test: starts what is there, watches each page for what no page of the daemon may do, and looks at
// it as the rules for accessible pages, and eyes, would.
//
// Takes: the daemon's address and a folder for pictures. Gives: pages, whose faults stand in `faults`.
// Does not know: what is on the page.

import fs from 'node:fs';
import path from 'node:path';
import { fileURLToPath } from 'node:url';
import puppeteer from 'puppeteer-core';

const AXE = fs.readFileSync(fileURLToPath(import.meta.resolve('axe-core/axe.min.js')), 'utf8');
const RULES = ['wcag2a', 'wcag2aa', 'wcag21a', 'wcag21aa', 'wcag22aa', 'best-practice'];
const NAMES = ['chromium', 'chromium-browser', 'google-chrome'];
export const PATIENCE_MS = 60_000;
export const WIDE = { width: 1280, height: 900 };
export const NARROW = { width: 360, height: 740 };
export const LOOKS = [['light', WIDE], ['light', NARROW], ['dark', NARROW], ['dark', WIDE]];

/** The program: as told, or the first of the known names that is there. */
export function program() {
  const folders = (process.env.PATH ?? '').split(path.delimiter).filter(Boolean);
  const places = [process.env.CHROMIUM, ...NAMES.flatMap((name) => folders.map((folder) => path.join(folder, name)))];
  return places.find((place) => place && fs.existsSync(place)) ?? null;
}

/** Whether an error of the console is the daemon's plain no, which a step awaited. */
const plainNo = (words) => /^Failed to load resource: .* status of (\d+)/.exec(words)?.[1];

async function seenAs(page, scheme, view) {
  await page.setViewport(view);
  await page.emulateMediaFeatures([{ name: 'prefers-color-scheme', value: scheme }, { name: 'prefers-reduced-motion', value: 'reduce' }]);
}

export class Browser {
  static async start(base, folder) {
    const browser = await puppeteer.launch({
      executablePath: program(), headless: true, protocolTimeout: 3 * PATIENCE_MS,
      // A sandbox of its own wants rights that containers do not give; all that is opened here is the daemon's.
      args: ['--no-sandbox', '--disable-dev-shm-usage', '--use-angle=swiftshader', '--enable-unsafe-swiftshader'],
    });
    return Object.assign(new Browser(), { browser, base, folder, faults: [], awaited: new Set(), looked: 0, scratch: await browser.newPage() });
  }

  /** A page of somebody who was never here. */
  async page() {
    const context = await this.browser.createBrowserContext();
    const page = await context.newPage();
    page.setDefaultTimeout(PATIENCE_MS);
    await seenAs(page, 'light', WIDE);
    const fault = (words) => this.faults.push(words);
    page.on('pageerror', (error) => fault(`script: ${error.message}`));
    page.on('console', (message) => {
      if (message.type() !== 'error' || this.awaited.has(plainNo(message.text()))) return;
      fault(`console: ${message.text()} ${message.location().url ?? ''}`);
    });
    page.on('request', (request) => {
      if (!request.url().startsWith(this.base) && !request.url().startsWith('data:')) fault(`asked elsewhere: ${request.url()}`);
    });
    return page;
  }

  /** What axe finds on the page, or in a frame of it; and whether the page is wider than its window. */
  async axe(place, name) {
    this.looked += 1;
    if (!await place.evaluate(() => Boolean(window.axe))) await place.evaluate(AXE);
    const { found, wide } = await place.evaluate(async (values) => {
      // What lies half under the bar would be told as too small to press.
      scrollTo(0, 0);
      const { violations } = await window.axe.run(document, { iframes: false, resultTypes: ['violations'], runOnly: { type: 'tag', values } });
      const found = violations.map(({ id, help, nodes }) => `${id}: ${help}: ${nodes.slice(0, 3).map(({ html }) => html.slice(0, 160)).join(' | ')}`);
      return { found, wide: document.documentElement.scrollWidth - innerWidth };
    }, RULES);
    for (const words of found) this.faults.push(`${name}: axe ${words}`);
    if (wide > 0) this.faults.push(`${name}: ${wide} px wider than the window`);
  }

  async shot(page, name) {
    await page.screenshot({ path: path.join(this.folder, `${name}.png`), fullPage: true });
  }

  /** Light and dark, wide and narrow: axe and a picture of each. `ready` waits for what comes late. */
  async look(page, name, ready = null) {
    for (const [scheme, view] of LOOKS) {
      await seenAs(page, scheme, view);
      await page.waitForFunction((wanted) => document.documentElement.dataset.theme === wanted, {}, scheme);
      await ready?.();
      const words = `${name}-${scheme}-${view.width}`;
      await this.axe(page, words);
      await this.shot(page, words);
      // What comes late is mostly drawn only where it is in sight.
      await ready?.();
      if (ready) await page.screenshot({ path: path.join(this.folder, `${words}-picture.png`) });
    }
    await seenAs(page, 'light', WIDE);
  }

  /** The part of an element's pixels that are of a strong colour, as drawn on the screen. */
  async colourful(element) {
    const png = await element.screenshot({ encoding: 'base64' });
    return this.scratch.evaluate(async (data) => {
      const image = await createImageBitmap(await (await fetch(`data:image/png;base64,${data}`)).blob());
      const canvas = new OffscreenCanvas(image.width, image.height).getContext('2d');
      canvas.drawImage(image, 0, 0);
      const { data: pixels } = canvas.getImageData(0, 0, image.width, image.height);
      let strong = 0;
      for (let at = 0; at < pixels.length; at += 4) {
        const rgb = pixels.subarray(at, at + 3);
        if (Math.max(...rgb) - Math.min(...rgb) > 60) strong += 1;
      }
      return strong / (pixels.length / 4);
    }, png);
  }
}

/** What the first view costs over a slow link: nothing is kept from before. */
export async function measured(page, base, done) {
  const link = await page.createCDPSession();
  await link.send('Network.enable');
  await link.send('Network.clearBrowserCache');
  await link.send('Network.emulateNetworkConditions', { offline: false, latency: 100, downloadThroughput: 125_000, uploadThroughput: 125_000 });
  let bytes = 0;
  let requests = 0;
  link.on('Network.loadingFinished', ({ encodedDataLength }) => { bytes += encodedDataLength; requests += 1; });
  const began = performance.now();
  const gone = page.goto(base);
  await page.waitForSelector(done, { visible: true });
  const seconds = (performance.now() - began) / 1000;
  await gone;
  await link.detach();
  return { bytes, requests, seconds };
}
