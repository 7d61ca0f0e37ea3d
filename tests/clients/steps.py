"""What both client scripts share: steps, waiting, time limits, and the daemon's own API for what a person would do."""

import argparse
import json
import os
import signal
import sys
import time
import urllib.parse
import urllib.request


def arguments(what):
    """The arguments of both scripts."""
    parser = argparse.ArgumentParser(description=what)
    parser.add_argument("base_url", metavar="BASE_URL", help="http://127.0.0.1:PORT")
    parser.add_argument("key", metavar="API_KEY", help="a key with the scopes read, print, control")
    parser.add_argument("file", metavar="FILE", help="a short G-code file that no check finds fault with")
    parser.add_argument("--long", metavar="FILE", help="one that prints for some seconds, to pause and cancel (else FILE)")
    parser.add_argument("--admin-key", metavar="KEY", help="a key that may allow key requests and say that the bed is clear")
    parser.add_argument("--timeout", type=float, default=120.0, metavar="SECONDS", help="for all the steps together")
    parser.add_argument("--skip", action="append", default=[], metavar="STEP", help="leave a step out")
    parser.add_argument("--stop", action="store_true", help="end with an emergency stop (the printer is dead then)")
    args = parser.parse_args()
    args.base_url = args.base_url.rstrip("/")
    args.long = args.long or args.file
    return args


def check(holds, why):
    """Fails the running step unless `holds`."""
    if not holds:
        raise AssertionError(why)


def number(value, what):
    """`value` as it is, if it is a number."""
    check(isinstance(value, (int, float)) and not isinstance(value, bool), f"{what} is no number: {value!r}")
    return value


class Steps:
    """Runs named steps and prints a line of each."""

    def __init__(self, args):
        self.args = args
        self.failed = set()
        self.running = "start"
        signal.signal(signal.SIGALRM, self._out_of_time)
        signal.setitimer(signal.ITIMER_REAL, args.timeout)

    def _out_of_time(self, *_):
        print(f"FAIL {self.running} the {self.args.timeout:g} s for all the steps are over", flush=True)
        os._exit(1)  # also out of a library that waits in a thread

    def _blocked(self, name, needs):
        self.running = name
        if name in self.args.skip:
            return True
        missing = [n for n in needs if n in self.failed]
        if missing:
            self.fail(name, f"{missing[0]} failed")
        return bool(missing)

    def fail(self, name, why):
        self.failed.add(name)
        print(f"FAIL {name} {' '.join(str(why).split())}", flush=True)

    def run(self, name, step, needs=()):
        """Runs a plain function."""
        if self._blocked(name, needs):
            return None
        try:
            result = step()
        except Exception as error:  # whatever a client throws at its user
            self.fail(name, f"{type(error).__name__}: {error}")
            return None
        print(f"ok {name}", flush=True)
        return result

    async def run_async(self, name, step, needs=()):
        """Runs a coroutine function."""
        if self._blocked(name, needs):
            return None
        try:
            result = await step()
        except Exception as error:
            self.fail(name, f"{type(error).__name__}: {error}")
            return None
        print(f"ok {name}", flush=True)
        return result

    def end(self):
        signal.setitimer(signal.ITIMER_REAL, 0)
        sys.stdout.flush()
        os._exit(1 if self.failed else 0)  # a client's leftover thread or socket does not hold us up


class Person:
    """What somebody does at the daemon's own pages while an application waits."""

    def __init__(self, args):
        parts = urllib.parse.urlsplit(args.base_url)
        self.root = f"{parts.scheme}://{parts.netloc}/api/v2"
        self.key = args.admin_key

    def ask(self, method, path, body=None):
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(self.root + path, data=data, method=method)
        request.add_header("X-Api-Key", self.key or "")
        if data is not None:
            request.add_header("Content-Type", "application/json")
        with urllib.request.urlopen(request, timeout=10) as reply:
            text = reply.read()
        return json.loads(text) if text else None

    def decide(self, app, allow):
        """Answers the key request of `app`."""
        until = time.monotonic() + 10
        while time.monotonic() < until:
            for request in self.ask("GET", "/keys/requests"):
                if request["app"] == app:
                    self.ask("POST", f"/keys/requests/{request['id']}", {"allow": allow})
                    return
            time.sleep(0.1)
        raise AssertionError(f"no key request of {app!r} at /api/v2/keys/requests")

    def clear_bed(self):
        """Takes the part off, as it were."""
        if self.key is None:
            return
        for printer in self.ask("GET", "/printers"):
            if printer.get("bed_clear") is False:
                self.ask("POST", f"/printers/{printer['id']}/actions", {"action": "bed_cleared"})

    def newest_job(self):
        """In words, for a line about a job that does not go on."""
        if self.key is None:
            return "(no admin key to ask with)"
        try:
            jobs = self.ask("GET", "/jobs")
            return f"newest job: {jobs[0]['state']}: {jobs[0]['state_words']}" if jobs else "there is no job"
        except Exception as error:
            return f"({error})"


def wait_until(what, look, person, seconds=60.0, every=0.05):
    """Looks until `look` gives something true, which is given back."""
    until = time.monotonic() + seconds
    while True:
        seen, now = look()
        if seen:
            return seen
        if time.monotonic() > until:
            raise AssertionError(f"not within {seconds:g} s: {what}; last seen {now!r}; {person.newest_job()}")
        time.sleep(every)
