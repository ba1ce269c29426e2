"""Traces as dicts of arrays."""
from . import _core


_FURTHER = [(f"force/{what}", "N", [f"force_{what}_{axis}_N" for axis in "xyz"]) for what in ("measured", "applied")]


class Trace(dict):
    """A trace: a dict of arrays, one row per step, under the datasets' names without the leading slash.

    'time' (T,) s; 'handle/position' (T, 3) mm; 'handle/orientation' (T, 4) x, y, z, w; 'handle/buttons' (T,);
    'reading_rejected' (T,) 0 or 1; 'bur/position', 'bur/velocity' (T, 3) mm, mm/s; 'bur/orientation' (T, 4); 'force/grinding' (T, 3) N, on the bur;
    'force/device' (T, 3) N, what the operator feels; 'force/measured' (T, 3) N where a rig recorded it;
    'force/applied' (T, 3) N, the load, of the drive 'load';
    'torque', 'torque_trial' (T,) mN m; 'power' (T,) W; 'rotation_rate' (T,) rev/s; 'stalled' (T,) 0 or 1;
    'stalled_fraction' (T,); 'contact/area' (T, 4) mm^2 and 'removed/volume' (T, 4) mm^3, by `tissues`;
    'contact/shank_area' (T,) mm^2; of a tooth with several bodies 'contact/body_area' (T, B) mm^2, by `bodies`. Positions and forces in W. Row 0 is the start, with zero forces.

    attributes: what the file says at its root: parameters (complete TOML), tooth_sha256, bur, drive, engine,
    toothprep_version, initial_overlap_mm3, and the audit torque_work_mJ, removed_energy_mJ, energy_ratio;
    bodies of a tooth with several, "36:tooth,37:neighbour"; rows_every of a trace that holds every such step only;
    of a live session that was paused, changed or taken back also events, (time, kind, arguments) of each, and event_burs.
    """

    tissues = ("enamel", "dentin", "pulp", "other")

    def __init__(self, arrays=(), attributes=None):
        """From arrays and attributes as they are described above."""
        super().__init__(arrays)
        self.attributes = dict(attributes or {})

    @property
    def bodies(self):
        """Names of the tooth's bodies, the columns of 'contact/body_area'; empty if it has one."""
        text = self.attributes.get("bodies", "")
        return tuple(entry.split(":")[0] for entry in text.split(",") if entry)

    def _columns(self):
        by_body = ("contact/body_area", "mm^2", [f"contact_body_{name}_mm2" for name in self.bodies])
        return [*_core.trace_columns(), *_FURTHER, by_body]

    @property
    def units(self):
        """The unit of every dataset, as in the file: {'force/device': 'N', ...}."""
        return {name: unit for name, unit, _ in self._columns() if name in self}

    def dataframe(self):
        """The trace as a pandas DataFrame, a column per component under the names of the CSV export
        (time_s, force_device_x_N, ...). ImportError without pandas."""
        import pandas
        columns = {}
        for name, _, names in self._columns():
            if name not in self:
                continue
            values = self[name]
            for at, column in enumerate(names):
                columns[column] = values if values.ndim == 1 else values[:, at]
        return pandas.DataFrame(columns)

    def save(self, path, overwrite=True):
        """Writes a trace file (.h5) that every program of the toolkit reads; whole or not at all. Error if it can't
        be written, or exists and overwrite is False; KeyError and ValueError for arrays that are missing or of another
        shape."""
        with _hdf5_to_ourselves():
            _core.save_trace(dict(self), self.attributes, path, overwrite)


class _NoLock:
    def __enter__(self):
        return self

    def __exit__(self, *_):
        return False


def _hdf5_to_ourselves():
    """HDF5 serves one thread at a time: h5py's lock, if h5py is there."""
    import sys
    objects = sys.modules.get("h5py._objects")
    return objects.phil if objects is not None else _NoLock()


def load_trace(path):
    """Reads a trace file (.h5), also a live recording that is being written or was cut off: the rows up to the last
    flush. Returns a Trace.

    HDF5 follows some damaged references blindly, so a child process reads the file first, within limits of time and
    memory; this doubles the time (0.3 s more for 240,000 rows). Raises Error (file, dataset, condition) for what is no
    trace.
    """
    with _hdf5_to_ourselves():
        return Trace(*_core.load_trace(path))


def load_trajectory(path):
    """Reads a motion of the handle: a script (.toml), a table (.csv), or a trace or recording (.h5).

    Returns a dict: 'time' (T,) s, 'handle/position' (T, 3) mm, 'handle/orientation' (T, 4) x, y, z, w,
    'handle/buttons' (T,), 'reading_rejected' (T,) 0 or 1, and 'force/measured' (T, 3) N where the file has it; as
    recorded, not resampled. Raises Error (file, place, condition) for what can't be read.
    """
    with _hdf5_to_ourselves():
        return _core.load_trajectory(path)
