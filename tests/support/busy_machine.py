"""Live sessions run in real time, and fail if more than a tenth of their ticks was missed, as on a machine that does other
things. Tests that aren't about that begin such a session again."""
import os

BUSY = "the machine is too busy"


def ended_well(status, said):
    return status == 0 or status == 1 and BUSY in said


def settled(run, args, folder):
    """What run() gives, a process that has ended; again, without its outputs, while the machine was too busy for it."""
    for _ in range(6):
        done = run()
        said = done.stderr if isinstance(done.stderr, str) else (done.stderr or b"").decode(errors="replace")
        if done.returncode == 0 or BUSY not in said:
            break
        words = [os.fsdecode(word) for word in args]
        for option, name in zip(words, words[1:]):
            if option in ("-o", "--prepared") and os.path.isfile(os.path.join(folder, name)):
                os.remove(os.path.join(folder, name))
    return done
