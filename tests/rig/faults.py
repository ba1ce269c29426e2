"""What the conformance suite does to a live session: faults of the device, and ways to end the program."""
import dataclasses
import signal
from dataclasses import dataclass, field

DURATION_S = 2.2
EARLIEST, LATEST = 550, 1500  # ticks, of what happens


@dataclass
class Case:
    """One session. Settings are of the stand-in, in TOML."""
    settings: str = ""
    args: tuple = ()
    status: int = 0
    words: tuple = ()  # each in stderr, as regular expressions
    signals: tuple = ()  # (tick of the servo, signal), in order
    speed: tuple = (0.6, 3.0)  # mm/s of the hand
    output: str = "read"  # "unread", "closed", "closed later"
    rules: dict = field(default_factory=dict)


def fault(what, at, ticks, more=""):
    return f'[[fault]]\nwhat = "{what}"\nat_tick = {at}\nticks = {ticks}\n{more}'


FOR_GOOD = 10**8
ENDED = {"fades": False}
REJECTED = r"readings of the hand could not be believed"
BACK = r"the readings are good again"


def offset(random):
    """A place 5 to 60 mm away, in any direction."""
    way = [random.gauss(0, 1) for _ in range(3)]
    length = sum(x * x for x in way)**0.5
    return "offset_mm = [" + ", ".join(f"{x / length * random.uniform(5, 60):.3f}" for x in way) + "]\n"


def tick(random):
    return random.randint(EARLIEST, LATEST)


def device_fault(what, words, ticks=FOR_GOOD):
    return lambda r: Case(fault(what, tick(r), ticks), status=1, words=(words, "recorded in"), rules=ENDED)


def transient(what, words, most=100):
    return lambda r: Case(fault(what, tick(r), r.randint(1, most)), words=(words,))


def no_start(settings, words, wait=True):
    return lambda r: Case(settings, ("--driver-wait-s", "1") if wait else (), 1, (words,),
                          rules=ENDED | {"recording": "absent"})


FAULTS = {
    "nothing": lambda r: Case(words=("ended by: duration",)),
    "glitch": lambda r: Case(fault("pose-jump", tick(r), 1, offset(r)), words=("jumped as no hand does", BACK, "1 " + REJECTED)),
    "pose-jump": lambda r: Case(fault("pose-jump", tick(r), r.randint(2, 60), offset(r)), words=("jumped as no hand does",)),
    "pose-jump-for-good": lambda r: Case(fault("pose-jump", tick(r), FOR_GOOD, offset(r)), status=1,
                                         words=("jumped as no hand does", "recorded in"), rules=ENDED),
    "nan": lambda r: Case(fault("nan", tick(r), r.randint(1, 60)), words=("not finite",)),
    "nan-for-good": lambda r: Case(fault("nan", tick(r), FOR_GOOD), status=1, words=("not finite", "recorded in"), rules=ENDED),
    "frozen": lambda r: Case(fault("frozen", r.randint(EARLIEST, 1100), r.randint(300, 450)),
                             words=("does not change any more, to the last bit",), speed=(1.5, 3.0)),
    "lost-calibration": device_fault("lost-calibration", "not calibrated: stopped; calibrate"),
    "warm-motors": transient("warm-motors", "motors are too warm: zero force"),
    "force-exceeded": transient("force-exceeded", "a force above the device's maximum", 5),
    "impulse-exceeded": transient("impulse-exceeded", "the force changed faster than the driver allows", 5),
    "velocity-exceeded": transient("velocity-exceeded", "the handle moved faster than the driver allows", 20),
    "force-error": device_fault("force-error", "reports a fault: stopped"),
    "device-fault": device_fault("device-fault", "reports a fault: stopped", 1),
    "comm-error": device_fault("comm-error", "does not answer: stopped; check its cable", 1),
    "timer-error": device_fault("timer-error", "servo timer failed", 1),
    "unplugged": device_fault("unplugged", "the device is gone: stopped; plug it in"),
    "let-go": lambda r: Case(fault("let-go", tick(r), r.randint(1, 200)), words=("nobody holds the stylus", "held again")),
    "late-ticks": lambda r: Case(f"[disturbances]\nlate_every = {r.randint(80, 250)}\nlate_s = {r.uniform(0.001, 0.004):.4f}\n"
                                 f"jitter_s = 0.0002\nseed = {r.randint(0, 10**6)}\n"),
    "missed-ticks": lambda r: Case(f"[disturbances]\nmissed_every = {r.randint(20, 60)}\n", words=("ticks were missed",)),
    "late-tick": lambda r: Case(fault("hanging-tick", tick(r), r.randint(2, 45))),
    "pause": lambda r: Case(fault("hanging-tick", tick(r), r.randint(60, 150))),
    "hanging-tick": lambda r: Case(fault("hanging-tick", tick(r), FOR_GOOD), status=1,
                                   words=("servo loop hangs: no tick came for", "recorded in"),
                                   rules=ENDED | {"force_may_stand": True}),
    "hanging-stop": lambda r: Case('[[fault]]\nwhat = "hanging-stop"\n', ("--duration-s", f"{r.uniform(0.8, 2):.3f}"), 1,
                                   ("does not come back from a call: it was given up", "recorded in")),
    "hanging-open": no_start('[[fault]]\nwhat = "hanging-open"\n', "driver hangs.*opens the device.*switch the device off"),
    "hanging-schedule": no_start('[[fault]]\nwhat = "hanging-schedule"\n', "driver hangs.*starts its servo"),
    "hanging-start": no_start('[[fault]]\nwhat = "hanging-start"\n', "driver hangs.*starts its servo"),
    "start-fails": no_start("start_fails = true\n", "the driver's servo did not start: timer error", False),
    "absent": no_start("present = false\n", "did not open the default device: device fault", False),
}


def asked(*signals):
    """Signals in quick succession, from some tick on."""
    def case(random):
        at = tick(random)
        times = [at]
        for _ in signals[1:]:
            times.append(times[-1] + random.randint(0, 40))
        return Case(args=("--duration-s", "20"), words=("ended by: asked to stop",), signals=tuple(zip(times, signals)))
    return case


def crash(number):
    return lambda r: Case(status=-number, signals=((tick(r), number),),
                          rules=ENDED | {"recording": "incomplete", "most_unrecorded": 500})


def killed(random):
    case = crash(signal.SIGKILL)(random)
    return dataclasses.replace(case, rules=case.rules | {"force_may_stand": True})


def stopped(number, words, after=(60, 120)):
    def case(random):
        at = tick(random)
        return Case(words=words, signals=((at, number), (at + random.randint(*after), signal.SIGCONT)))
    return case


ENDINGS = {
    "INT": asked(signal.SIGINT),
    "TERM": asked(signal.SIGTERM),
    "QUIT": asked(signal.SIGQUIT),
    "HUP": asked(signal.SIGHUP),
    "USR1": asked(signal.SIGUSR1),
    "ALRM": asked(signal.SIGALRM),
    "INT-INT-TERM": asked(signal.SIGINT, signal.SIGINT, signal.SIGTERM),
    "PIPE": lambda r: Case(words=("ended by: duration",), signals=((tick(r), signal.SIGPIPE),)),
    "output-closed": lambda r: Case(output="closed"),
    "reader-leaves": lambda r: Case(output="closed later"),
    "output-unread": lambda r: Case(output="unread"),
    "STOP-CONT": stopped(signal.SIGSTOP, ("ended by: duration",)),
    "TSTP-CONT": stopped(signal.SIGTSTP, ("paused: no force", "goes on after", "ended by: duration")),
    "TSTP-CONT-soon": stopped(signal.SIGTSTP, ("ended by: duration",), (0, 30)),
    "ABRT": crash(signal.SIGABRT),
    "SEGV": crash(signal.SIGSEGV),
    "KILL": killed,
}

CASES = FAULTS | ENDINGS
