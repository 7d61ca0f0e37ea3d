#!/usr/bin/env python3
"""Goes through what users of moonraker-api (Home Assistant's Moonraker) and slicers do, against a daemon. See README.md."""

import asyncio
import logging
import os
import time
import urllib.parse

import aiohttp
from moonraker_api import ClientNotAuthenticatedError, MoonrakerClient, MoonrakerListener

from steps import Person, Steps, arguments, check, number

# What Home Assistant reads of each object, and fails without.
READ = {
    "webhooks": ("state", "state_message"),
    "print_stats": ("state", "message", "filename", "print_duration", "total_duration", "filament_used"),
    "display_status": ("message", "progress"),
    "virtual_sdcard": ("progress", "is_active"),
    "toolhead": ("position",),
    "extruder": ("temperature", "target", "power"),
    "heater_bed": ("temperature", "target", "power"),
    "idle_timeout": ("state",),
    "system_stats": ("sysload", "memavail"),
}


class Heard(MoonrakerListener):
    """Keeps what the server told unasked."""

    def __init__(self):
        self.told = []

    async def on_notification(self, method, data):
        self.told.append((method, data))

    def of(self, method):
        return [data for name, data in self.told if name == method]


def answered(result, what):
    """`result`, unless it is an error."""
    check(not (isinstance(result, dict) and "error" in result), f"{what}: {result!r}")
    return result


async def main():
    args = arguments(__doc__)
    logging.getLogger("moonraker_api").setLevel(logging.CRITICAL)  # a refused key is what we wait for
    steps, person = Steps(args), Person(args)
    at = urllib.parse.urlsplit(args.base_url)
    secure = at.scheme == "https"
    place = {"host": at.hostname, "port": at.port or (443 if secure else 80), "route_prefix": at.path or None, "ssl": secure}
    http = aiohttp.ClientSession(headers={"X-Api-Key": args.key}, timeout=aiohttp.ClientTimeout(total=30))
    heard = Heard()
    client = MoonrakerClient(heard, api_key=args.key, timeout=15, **place)

    async def connect():
        check(await client.connect(), "not connected")

    async def wrong_key():
        for key in (None, args.key + "x"):
            stranger = MoonrakerClient(Heard(), api_key=key, timeout=5, **place)
            try:
                await stranger.connect()
            except ClientNotAuthenticatedError:
                continue
            finally:
                await stranger.disconnect()
                if stranger.session is not None:
                    await stranger.session.close()
            raise AssertionError(f"connected with the key {key!r}")

    async def info():
        server = answered(await client.get_server_info(), "server.info")
        check(server["klippy_state"] == "ready" and server["klippy_connected"] is True, f"klippy is {server['klippy_state']!r}")
        check(server["moonraker_version"], "no moonraker_version")
        check(await client.get_klipper_status() == "ready", "the state of klippy is not ready")
        host = answered(await client.get_host_info(), "printer.info")
        check(host["state"] == "ready" and host["hostname"], f"printer.info says {host!r}")
        check(isinstance(host["state_message"], str), "no state_message")
        number((await client.get_websocket_id())["websocket_id"], "websocket_id")

    async def identify():
        who = {"client_name": "outrigger-test", "version": "1.0", "type": "other", "url": "https://outrigger.invalid"}
        number((await client.call_method("server.connection.identify", **who))["connection_id"], "connection_id")

    async def objects():
        modules = await client.get_supported_modules()
        missing = [name for name in READ if name not in modules]
        check(not missing, f"not listed: {missing}")
        asked = {name: list(fields) for name, fields in READ.items()}
        status = answered(await client.call_method("printer.objects.query", objects=asked), "query")["status"]
        for name, fields in READ.items():
            lost = [field for field in fields if field not in status[name]]
            check(not lost, f"{name} lacks {lost}")
        number(status["extruder"]["temperature"], "extruder.temperature")
        number(status["heater_bed"]["target"], "heater_bed.target")
        check(len(status["toolhead"]["position"]) >= 3, "toolhead.position has no three numbers")
        only = await client.call_method("printer.objects.query", objects={"print_stats": ["state"], "no_such_object": None})
        check(set(only["status"]) == {"print_stats"}, f"asked for one object there is, got {list(only['status'])}")
        check(set(only["status"]["print_stats"]) == {"state"}, "asked for one field, got more")
        number(only["eventtime"], "eventtime")

    async def unknown_method():
        result = await client.call_method("no.such.method")
        check(result.get("error", {}).get("code") == -32601, f"answered {result!r}")

    async def rest():
        check((await client.call_method("server.webcams.list"))["webcams"] is not None, "no webcams")
        check("error" not in await client.call_method("printer.gcode.help"), "printer.gcode.help is an error")
        system = await client.call_method("machine.system_info")
        number(system["system_info"]["cpu_info"]["total_memory"], "total_memory")
        store = answered(await client.call_method("server.temperature_store"), "temperature_store")
        check(len(store["extruder"]["temperatures"]) == len(store["extruder"]["targets"]), "as many targets as temperatures")
        for method in ("server.history.totals", "server.job_queue.status", "machine.update.status"):
            check(isinstance(await client.call_method(method), dict), f"{method} is neither answered nor refused")
        roots = answered(await client.call_method("server.files.roots"), "roots")
        check(any(r["name"] == "gcodes" and "w" in r["permissions"] for r in roots), f"no writable gcodes: {roots!r}")

    async def nothing_to_pause():
        for method in ("printer.print.pause", "printer.print.cancel"):
            check("error" in await client.call_method(method), f"{method} without a job went through")

    await steps.run_async("moonraker.connect", connect)
    known = ("moonraker.connect",)
    await steps.run_async("moonraker.wrong_key", wrong_key)
    await steps.run_async("moonraker.info", info, known)
    await steps.run_async("moonraker.identify", identify, known)
    await steps.run_async("moonraker.objects", objects, known)
    await steps.run_async("moonraker.unknown_method", unknown_method, known)
    await steps.run_async("moonraker.rest", rest, known)
    await steps.run_async("moonraker.nothing_to_pause", nothing_to_pause, known)

    # --- a job to its end
    async def upload(path, name, start):
        form = aiohttp.FormData(quote_fields=False)  # the name as slicers write it
        form.add_field("root", "gcodes")
        if start:
            form.add_field("print", "true")
        with open(path, "rb") as file:
            form.add_field("file", file, filename=name, content_type="application/octet-stream")
            async with http.post(args.base_url + "/server/files/upload", data=form) as reply:
                check(reply.status == 201, f"{reply.status}: {await reply.text()}")
                said = await reply.json()
        check(said["item"]["path"] == name and said["item"]["root"] == "gcodes", f"item is {said['item']!r}")
        check(isinstance(said["print_started"], bool) and isinstance(said["print_queued"], bool), f"the reply is {said!r}")
        check(said["print_started"] or said["print_queued"] or not start, "a print was asked for: neither started nor queued")
        files = answered(await client.call_method("server.files.list", root="gcodes"), "files.list")
        check(any(f["path"] == name and f["size"] == os.path.getsize(path) for f in files), "the file is not in the list")
        facts = answered(await client.call_method("server.files.metadata", filename=name), "files.metadata")
        check(facts["filename"] == name and facts["size"] == os.path.getsize(path), f"its metadata: {facts!r}")

    async def now():
        asked = {"print_stats": None, "display_status": None, "virtual_sdcard": None}
        return answered(await client.call_method("printer.objects.query", objects=asked), "query")["status"]

    async def reaches(*states, seconds=30.0, each=lambda status: None):
        until = time.monotonic() + seconds
        while True:
            status = await now()
            each(status)
            state = status["print_stats"]["state"]
            if state in states:
                return status
            why = f"not within {seconds:g} s: {' or '.join(states)}; state {state!r}; {person.newest_job()}"
            check(time.monotonic() < until, why)
            await asyncio.sleep(0.05)

    name, long_name = "moonraker test.gcode", "moonraker test long.gcode"

    async def subscribe():
        asked = {"print_stats": ["state"], "display_status": ["progress"], "extruder": None}
        first = answered(await client.call_method("printer.objects.subscribe", objects=asked), "subscribe")
        check(first["status"]["print_stats"]["state"] in ("standby", "complete", "cancelled", "error"), f"{first!r}")

    async def upload_and_print():
        person.clear_bed()
        await upload(args.file, name, True)
        check(heard.of("notify_filelist_changed"), "no notify_filelist_changed")
        params = heard.of("notify_filelist_changed")[-1]
        check(isinstance(params, list) and params[0]["item"]["path"] == name, f"notify_filelist_changed {params!r}")

    async def to_the_end():
        last = 0.0

        def forward(status):
            nonlocal last
            if status["print_stats"]["state"] != "printing":
                return
            check(status["print_stats"]["filename"] == name, f"filename is {status['print_stats']['filename']!r}")
            progress = number(status["display_status"]["progress"], "progress")
            check(last <= progress <= 1.0, f"from {last} to {progress}")
            last = progress

        await reaches("printing", "complete", each=forward)
        end = await reaches("complete", "error", "cancelled", seconds=args.timeout, each=forward)
        check(end["print_stats"]["state"] == "complete", f"it ended as {end['print_stats']!r}")
        told = [params[0]["print_stats"]["state"] for params in heard.of("notify_status_update") if "state" in params[0].get("print_stats", {})]
        check("printing" in told and told[-1] == "complete", f"the subscription told the states {told}")

    async def by_http():
        where = "/printer/objects/query?print_stats=state&display_status=progress"
        async with http.get(args.base_url + where) as reply:
            said = await reply.json()
        check(next(iter(said)) == "result", "the reply does not begin with result")
        check(said["result"]["status"]["print_stats"] == {"state": "complete"}, f"{said!r}")

    await steps.run_async("moonraker.subscribe", subscribe, known)
    await steps.run_async("moonraker.upload_and_print", upload_and_print, known)
    await steps.run_async("moonraker.job_to_its_end", to_the_end, ("moonraker.subscribe", "moonraker.upload_and_print"))
    await steps.run_async("moonraker.by_http", by_http, ("moonraker.job_to_its_end",))

    # --- pause, resume, cancel
    async def call(method, **params):
        check(answered(await client.call_method(method, **params), method) == "ok", f"{method} is not ok")

    async def second():
        person.clear_bed()
        await upload(args.long, long_name, False)
        await call("printer.print.start", filename=long_name)
        await reaches("printing")

    async def pause():
        await call("printer.print.pause")
        await reaches("paused")

    async def resume():
        await call("printer.print.resume")
        await reaches("printing")

    async def cancel():
        await call("printer.print.cancel")
        await reaches("cancelled", "standby")

    async def delete():
        for each in (name, long_name):
            answered(await client.call_method("server.files.delete_file", path="gcodes/" + each), "delete")
        files = await client.call_method("server.files.list", root="gcodes")
        check(not any(f["path"] in (name, long_name) for f in files), "deleted files are in the list")

    async def stop():
        await call("printer.emergency_stop")
        until = time.monotonic() + 10
        while await client.get_klipper_status() == "ready":
            check(time.monotonic() < until, "stopped, and klippy is still ready")
            await asyncio.sleep(0.05)

    printing = ("moonraker.second_job",)
    await steps.run_async("moonraker.second_job", second, ("moonraker.job_to_its_end",))
    await steps.run_async("moonraker.pause", pause, printing)
    await steps.run_async("moonraker.resume", resume, ("moonraker.pause", *printing))
    await steps.run_async("moonraker.cancel", cancel, printing)
    await steps.run_async("moonraker.delete", delete, ("moonraker.upload_and_print", *printing))
    if args.stop:
        await steps.run_async("moonraker.emergency_stop", stop, known)

    async def disconnect():
        await client.disconnect()
        check(not client.is_connected, "still connected")

    await steps.run_async("moonraker.disconnect", disconnect, known)
    await http.close()
    if client.session is not None:
        await client.session.close()
    steps.end()


if __name__ == "__main__":
    asyncio.run(main())
