"""Progress of long calls."""
import sys


def _print_line(stage, done):
    sys.stderr.write(f"\r{100 * done:3.0f} %  {stage:<30}" if done < 1 else "\r" + " " * 38 + "\r")
    sys.stderr.flush()


def callback(progress):
    """What `progress=` of a call means: True prints a line on stderr, a function is called as
    progress(stage, done), done from 0 to 1; None and False do nothing."""
    if progress is None or progress is False:
        return None
    if progress is True:
        return _print_line
    if callable(progress):
        return progress
    raise TypeError("progress is True, False, None or a function of stage and done")
