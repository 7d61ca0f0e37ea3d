#!/usr/bin/env python3
"""Goes through what users of pyoctoprintapi (Home Assistant's) and octorest do, against a daemon. See README.md."""

import asyncio
import os
import time
import urllib.parse

import aiohttp
import pyoctoprintapi
import requests
from octorest import OctoRest
from octorest.client import AuthorizationRequestPollingResult as Decision
from pyoctoprintapi.exceptions import UnauthorizedException

from steps import Person, Steps, arguments, check, number, wait_until

APP = "Outrigger client test"
ACTIVE = ("Starting", "Printing", "Pausing", "Paused", "Resuming", "Finishing", "Cancelling")


class Patient(requests.Session):
    """A session that does not wait for ever."""

    def request(self, *args, **kwargs):
        kwargs.setdefault("timeout", 10)
        return super().request(*args, **kwargs)


def refused(status, call):
    """Fails unless octorest says that the server answered `status`."""
    try:
        call()
    except RuntimeError as error:
        check(f"({status})" in str(error), f"{status} was due, not {error}")
    else:
        raise AssertionError(f"{status} was due, and it went through")


async def raises(kind, call):
    """Fails unless awaiting `call` raises `kind`."""
    try:
        await call
    except kind:
        return
    raise AssertionError(f"{kind.__name__} was due, and it went through")


def home_assistant(args, session, key):
    """A client as Home Assistant makes it from what a user typed."""
    at = urllib.parse.urlsplit(args.base_url)
    secure = at.scheme == "https"
    port = at.port or (443 if secure else 80)
    client = pyoctoprintapi.OctoprintClient(at.hostname, session, port, secure, (at.path or "") + "/")
    if key is not None:
        client.set_api_key(key)
    return client


async def main():
    args = arguments(__doc__)
    steps, person = Steps(args), Person(args)
    connector = aiohttp.TCPConnector(force_close=True)
    session = aiohttp.ClientSession(connector=connector, timeout=aiohttp.ClientTimeout(total=10))
    ha = home_assistant(args, session, args.key)

    # --- what Home Assistant reads
    async def server():
        info = await ha.get_server_info()
        check(isinstance(info.version, str) and info.version, f"no version: {info.version!r}")

    async def settings():
        discovery = await ha.get_discovery_info()
        check(discovery is not None and discovery.upnp_uuid, "no plugins.discovery.upnpUuid, and it is the unique id")
        tracking = await ha.get_tracking_info()
        if tracking is not None:
            check(isinstance(tracking.enabled, bool) and tracking.unique_id, "half of the tracking settings")
        webcam = await ha.get_webcam_info()
        if webcam is not None and webcam.enabled:
            for field in ("stream_url", "internal_snapshot_url", "external_snapshot_url", "flip_horizontal",
                          "flip_vertical", "rotate_90", "snapshot_ssl_validation_enabled"):
                getattr(webcam, field)

    async def printer():
        info = await ha.get_printer_info()
        flags = info.state.flags
        for name in ("operational", "ready", "printing", "paused", "pausing", "cancelling", "error", "closed_or_error",
                     "finishing", "resuming", "sd_ready"):
            check(isinstance(getattr(flags, name), bool), f"the flag {name} is {getattr(flags, name)!r}")
        check(flags.operational and flags.ready and not flags.printing, f"not ready: {info.state.text!r}")
        check(info.has_heated_bed, "no bed among the temperatures")
        tools = {tool.name: tool for tool in info.temperatures}
        for name in ("tool0", "bed"):
            number(tools[name].actual_temp, f"{name}.actual")
            number(tools[name].target_temp, f"{name}.target")
            number(tools[name].offset, f"{name}.offset")

    async def idle():
        job = await ha.get_job_info()
        check(job.state == "Operational", f"an idle printer's job state is {job.state!r}")
        check(job.error is None, f"an error: {job.error!r}")

    async def wrong_key():
        for key in ("", args.key + "x"):
            stranger = home_assistant(args, session, key)
            await raises(UnauthorizedException, stranger.get_printer_info())
            await raises(UnauthorizedException, stranger.get_job_info())

    async def heaters_off():
        await ha.turn_bed_off()  # asks for //api/printer/bed
        await ha.turn_tool_off("tool0")

    await steps.run_async("pyoctoprintapi.server", server)
    await steps.run_async("pyoctoprintapi.settings", settings)
    await steps.run_async("pyoctoprintapi.printer", printer)
    await steps.run_async("pyoctoprintapi.job_idle", idle)
    await steps.run_async("pyoctoprintapi.wrong_key", wrong_key)
    await steps.run_async("pyoctoprintapi.heaters_off", heaters_off)

    # --- what octorest reads
    def rest():
        client = OctoRest(url=args.base_url, apikey=args.key, session=Patient())
        check(client.version["api"] and client.version["server"], f"version says {client.version!r}")
        check(client.version.get("text", "OctoPrint").startswith("OctoPrint"), f"version says {client.version!r}")
        return client

    octo = steps.run("octorest.version", rest)
    known = ("octorest.version",)

    def connection():
        check(octo.state() == "Operational", f"current.state is {octo.state()!r}")

    def temperatures():
        check(octo.printer(exclude=["sd"])["state"]["flags"]["operational"] is True, "not operational")
        number(octo.tool()["tool0"]["actual"], "tool0.actual")
        number(octo.bed()["bed"]["actual"], "bed.actual")

    def profiles():
        current = [p for p in octo.printer_profiles()["profiles"].values() if p.get("current")]
        check(len(current) == 1, f"{len(current)} printer profiles are the current one")
        for axis in "xyze":
            number(current[0]["axes"][axis]["speed"], f"axes.{axis}.speed")

    def gcode():
        octo.gcode("M105")
        octo.gcode(["M105", "M115"])

    steps.run("octorest.connection", connection, known)
    steps.run("octorest.temperatures", temperatures, known)
    steps.run("octorest.profiles", profiles, known)
    steps.run("octorest.gcode", gcode, known)
    steps.run("octorest.nothing_to_pause", lambda: refused(409, octo.pause), known)
    steps.run("octorest.nothing_to_cancel", lambda: refused(409, octo.cancel), known)
    steps.run("octorest.no_such_file", lambda: refused(404, lambda: octo.select("nothing of that name.gcode")), known)

    # --- a job to its end
    name, long_name = "client test.gcode", "client test long.gcode"

    def upload(path, as_name):
        with open(path, "rb") as file:
            reply = octo.upload((as_name, file))
        check(reply["done"] is True, f"done is {reply['done']!r}")
        local = reply["files"]["local"]
        check(local["name"] == as_name and local["origin"] == "local", f"files.local is {local!r}")
        listed = [f for f in octo.files()["files"] if f["name"] == as_name]
        check(listed, "the file is not in the list")
        check(listed[0]["size"] == os.path.getsize(path), f"its size is {listed[0]['size']!r}")
        check(octo.files_info("local", as_name)["name"] == as_name, "its own page is of another file")

    def start(as_name):
        person.clear_bed()
        octo.select(as_name, print=True)

    def job():
        info = octo.job_info()
        return info["state"], info["progress"]["completion"], info["job"]["file"]["name"]

    def to_the_end():
        seen, last, begun = [], 0.0, time.monotonic()

        def look():
            nonlocal last
            state, completion, file = job()
            if not seen or seen[-1] != state:
                seen.append(state)
            if state.startswith(ACTIVE):
                check(file == name, f"the job's file is {file!r}")
                if completion is not None:
                    number(completion, "progress.completion")
                    check(last <= completion <= 100.0, f"from {last} % to {completion} %")
                    last = completion
            active = any(s.startswith(ACTIVE) for s in seen) or (file == name and (completion or 0) >= 100.0)
            check(not state.startswith(("Error", "Offline")), f"the job ended as {state!r}")
            return active and state == "Operational", (state, completion, round(time.monotonic() - begun, 1))

        wait_until("the job printed and the printer Operational again", look, person, seconds=args.timeout)

    steps.run("octorest.upload", lambda: upload(args.file, name), known)
    steps.run("octorest.select_print", lambda: start(name), ("octorest.upload",))
    steps.run("octorest.job_to_its_end", to_the_end, ("octorest.select_print",))

    # --- pause, resume, cancel, of a second upload
    async def flags():
        return (await ha.get_printer_info()).state.flags

    async def reaches(what, test, seconds=30.0):
        until = time.monotonic() + seconds
        while True:
            state = (await ha.get_job_info()).state
            if test(state):
                return state
            check(time.monotonic() < until, f"not within {seconds:g} s: {what}; state {state!r}; {person.newest_job()}")
            await asyncio.sleep(0.05)

    async def second():
        upload(args.long, long_name)
        start(long_name)
        await reaches("printing", lambda s: s.startswith("Printing"))
        check((await flags()).printing, "Printing, and the flag printing is false")

    async def pause():
        await ha.pause_job()
        await reaches("paused", lambda s: s == "Paused")
        now = await flags()
        check(now.paused and not now.printing, "Paused, and the flags say otherwise")
        await ha.pause_job()  # does nothing
        check((await ha.get_job_info()).state == "Paused", "a second pause changed something")

    async def resume():
        await ha.resume_job()
        await reaches("printing again", lambda s: s.startswith("Printing"))

    async def toggle():
        octo.toggle()
        await reaches("paused by toggle", lambda s: s == "Paused")
        octo.toggle()
        await reaches("printing by toggle", lambda s: s.startswith("Printing"))

    def overwrite():
        with open(args.file, "rb") as file:
            refused(409, lambda: octo.upload((long_name, file)))

    async def cancel():
        await ha.cancel_job()
        await reaches("cancelled", lambda s: s == "Operational")
        now = await flags()
        check(now.ready and not (now.printing or now.paused or now.cancelling), "Operational, and the flags say otherwise")

    printing = ("pyoctoprintapi.second_job",)
    await steps.run_async("pyoctoprintapi.second_job", second, ("octorest.job_to_its_end",))
    steps.run("octorest.no_overwriting_the_running", overwrite, printing)
    await steps.run_async("pyoctoprintapi.pause", pause, printing)
    await steps.run_async("pyoctoprintapi.resume", resume, ("pyoctoprintapi.pause", *printing))
    await steps.run_async("octorest.toggle", toggle, ("pyoctoprintapi.resume", *printing))
    await steps.run_async("pyoctoprintapi.cancel", cancel, printing)

    def delete():
        for each in (name, long_name):
            octo.delete(each)
            refused(404, lambda: octo.files_info("local", each))

    steps.run("octorest.delete", delete, ("octorest.upload",))

    # --- applications that ask for a key
    def ask_key():
        stranger = OctoRest(url=args.base_url, session=Patient())
        check(stranger.probe_app_keys_workflow_support(), "no /plugin/appkeys/probe")
        at = stranger.start_authorization_process(APP)
        check(stranger.poll_auth_request_decision(at) == (Decision.STILL_WAITING, None), "decided before anybody was asked")
        person.decide(APP, True)
        answer, key = stranger.poll_auth_request_decision(at)
        check(answer == Decision.GRANTED and key, f"allowed, and the answer is {answer}")
        stranger.load_api_key(key)
        check(stranger.printer()["state"]["flags"]["operational"] is True, "the new key does not read the printer")

    def ask_key_denied():
        stranger = OctoRest(url=args.base_url, session=Patient())
        at = stranger.start_authorization_process(APP + " 2")
        person.decide(APP + " 2", False)
        check(stranger.poll_auth_request_decision(at) == (Decision.NOPE, None), "denied, and not told so")

    async def ask_key_async():
        stranger = home_assistant(args, session, None)
        asking = asyncio.create_task(stranger.request_app_key(APP + " 3", None, 10))
        await asyncio.to_thread(person.decide, APP + " 3", True)
        stranger.set_api_key(await asking)
        check((await stranger.get_printer_info()).state.flags.operational is True, "the new key does not read the printer")

    if args.admin_key is not None:
        steps.run("octorest.appkey", ask_key)
        steps.run("octorest.appkey_denied", ask_key_denied)
        await steps.run_async("pyoctoprintapi.appkey", ask_key_async)

    await session.close()
    steps.end()


if __name__ == "__main__":
    asyncio.run(main())
