"""The long calls: voxelize, calibrate, score, render. Each returns what its command's JSON holds, as a dict."""
import json
import os

from . import _core
from ._core import Tooth, set_threads
from ._data import data_folder
from ._progress import callback
from ._trace import _hdf5_to_ourselves

__all__ = ["Fit", "Voxelized", "calibrate", "render", "score", "set_threads", "voxelize"]


def _path(path):
    """A path or None as text."""
    return "" if path is None else os.fspath(path)


class Voxelized(dict):
    """What `voxelize --json` prints, as a dict; `tooth` is the Tooth that was made."""

    def __init__(self, figures, tooth):
        """From the figures and the Tooth."""
        super().__init__(figures)
        self.tooth = tooth


class Fit(dict):
    """What fit.json holds, as a dict; `parameters_toml` is the text of a parameter file with what was found."""

    def __init__(self, figures, parameters_toml):
        """From the figures and the text."""
        super().__init__(figures)
        self.parameters_toml = parameters_toml


def voxelize(source=None, output=None, *, voxel_mm=0.1, thresholds=None, hounsfield=None, labels=None, meshes=None,
             spacing_mm=None, tooth=None, neighbours=None, series="", component=None, roi_mm=None,
             allow_irregular=False, repair=True, smooth_labels=True, overwrite=True, progress=None):
    """A CT scan, a segmentation or closed shells to a layered tooth.

    source      a folder with a DICOM series, .dcm, .nrrd, .nhdr, .nii, .nii.gz, .mha or .mhd
    output      where to save the tooth (.vdb), or None
    thresholds  grey values (surroundings|dentin, dentin|enamel); None: found in the histogram
    hounsfield  name of a preset of borders in Hounsfield units, in place of the histogram's peaks
    labels      the source is a segmentation: {"enamel": 2, "dentin": 3, ...}
    smooth_labels  False keeps the steps of its voxels
    meshes      in place of a source: {"enamel": path, "dentin": path, ...}, surfaces in mm; repair mends and
                closes them where that invents no shape (a note says so), else faults are refused
    spacing_mm  voxel size of the scan in place of the file's: a number or three
    tooth       of several: 1 is the largest; or a place in it, (x, y, z), mm, W. None: the largest of a scan, all
                that a segmentation or a mesh holds
    neighbours  of a scan or a segmentation of several teeth, kept beside `tooth`, which must be given: {name: a number
                or place, as for tooth}
    series, component, roi_mm (((x, y, z), (x, y, z)), lower and upper corner), allow_irregular: as the command's
    progress    True for a line on stderr, or a function called as progress(stage, done)

    Returns a Voxelized: the dict that `toothprep voxelize --json` prints (volume_mm3, threshold_dentin, notes, ...),
    with the Tooth as its attribute `tooth`. Notes are UserWarnings, too. Ctrl-C ends the work. Raises Error (file,
    place, condition, remedy) for what can't be a scan or holds no tooth; ValueError and TypeError for wrong arguments.
    """
    if (source is None) == (meshes is None):
        raise ValueError("voxelize needs a source or meshes, and not both")
    if neighbours is not None and (meshes is not None or tooth is None):
        raise ValueError("neighbours are of a scan or a segmentation, beside the tooth that is given")
    if spacing_mm is not None and not hasattr(spacing_mm, "__len__"):
        spacing_mm = (spacing_mm,) * 3
    if output is not None and not overwrite and os.path.exists(output):
        raise FileExistsError(f"{os.fspath(output)} exists; give overwrite=True")
    if meshes is not None:
        made, text = _core.voxelize_meshes(dict(meshes), voxel_mm, repair, tooth, callback(progress))
    else:
        options = {"source": source, "voxel_mm": voxel_mm, "thresholds": thresholds, "hounsfield": hounsfield,
                   "labels": labels, "spacing_mm": spacing_mm, "tooth": tooth, "neighbours": neighbours, "series": series,
                   "component": component, "roi_mm": roi_mm, "allow_irregular": allow_irregular,
                   "smooth_labels": smooth_labels}
        made, text = _core.voxelize_scan(options, os.path.join(data_folder(), "scans", "hounsfield.toml"),
                                         callback(progress))
    figures = json.loads(text)
    if output is not None:
        made.save(output, overwrite)
        figures["tooth"] = os.fspath(output)
    return Voxelized(figures, made)


def calibrate(tooth, measured, bur, *, parameters=None, rotation_rate_rev_s=None, drive="direct", estimate=(),
              bias_n=None, drift_n_per_s=None, delay_ms=0.0, largest_delay_ms=50.0, sensor_rotation_deg=None,
              handpiece_weight_n=None, sensor_on="tooth", force_on="bur", force_unit="auto", range_n=None,
              lowpass_hz=0.0, noise_n=None, loss="huber", bootstrap=1000, block_s=0.0, folds=5, seed=1,
              fit_droop=False, fit_droop_exponent=False, fit_rotor=False, law=(),
              smooth_motion_ms=0.0, allow_gaps=False, progress=None):
    """u and alpha per tissue from measured forces, with their uncertainty.

    tooth       the Tooth before the recordings, or its path
    measured    paths of recordings (or one): .h5 with /force/measured, or .csv with fx_N, fy_N, fz_N
    bur         a Bur, or what Bur() takes
    parameters  a dict, a path or a preset's name: rotation rate, step, start values; rotation_rate_rev_s wins
    drive       'direct': the bur's motion was recorded; 'coupled': the handle's
    estimate    what else to estimate: 'delay', 'drift', 'lowpass', 'rotation', 'weight'
    bias_n      (3,) N; None: estimated for each recording
    law         beyond the paper's, to fit and compare: 'size', 'ratio', 'rubbing', 'size-rubbing', 'up-cutting', or 'all'
    others      as the options of `toothprep calibrate`, in the unit of their name
    progress    True for a line on stderr, or a function called as progress(stage, done)

    Returns a Fit: what fit.json holds, as a dict (tissues.{name}.u_j_per_mm3, .alpha, .identifiable, residual_rms_n,
    ...); its attribute parameters_toml is a parameter file. Ctrl-C ends the work. Raises Error for recordings that
    can't be read or never touch the tooth, ValueError and TypeError for wrong arguments.
    """
    name = "tooth" if isinstance(tooth, Tooth) else os.fspath(tooth)
    if isinstance(measured, (str, os.PathLike)):
        measured = [measured]
    options = {"parameters": parameters, "rotation_rate_rev_s": rotation_rate_rev_s, "drive": drive,
               "estimate": [estimate] if isinstance(estimate, str) else list(estimate), "bias_n": bias_n,
               "drift_n_per_s": drift_n_per_s, "delay_ms": delay_ms, "largest_delay_ms": largest_delay_ms,
               "sensor_rotation_deg": sensor_rotation_deg, "handpiece_weight_n": handpiece_weight_n,
               "sensor_on": sensor_on, "force_on": force_on, "force_unit": force_unit, "range_n": range_n,
               "lowpass_hz": lowpass_hz, "noise_n": noise_n, "loss": loss, "bootstrap": bootstrap,
               "block_s": block_s, "folds": folds, "seed": seed, "fit_droop": fit_droop,
               "fit_droop_exponent": fit_droop_exponent, "fit_rotor": fit_rotor, "law": [law] if isinstance(law, str) else list(law),
               "smooth_motion_ms": smooth_motion_ms, "allow_gaps": allow_gaps}
    loaded = tooth if isinstance(tooth, Tooth) else _core.load(tooth)
    with _hdf5_to_ourselves():
        text, toml = _core.calibrate(loaded, name, [os.fspath(m) for m in measured], bur, options, callback(progress))
    return Fit(json.loads(text), toml)


def score(original, prepared, *, target=None, trace=None, type=None, rubric=None, axis=None, mesial=None, buccal=None,
          register=False, voxel_mm=0.1, undercut_threshold_mm=0.03, force_limit_n=2.0, progress=None):
    """Figures and points of a prepared cavity or crown.

    original, prepared, target  paths of teeth (.vdb) or closed meshes
    trace      path of the recording of the work (.h5): adds time, forces, stalls
    type       'crown', 'class1' or 'class2'; None: the rubric's, or found
    rubric     path of a rubric, 'none', or None: the one shipped for the type
    axis, mesial, buccal  directions in W, (3,); None: recorded in the tooth, or found
    register   lay prepared and target on the original first
    voxel_mm   for an original that is a mesh
    progress   True for a line on stderr, or a function called as progress(stage, done)

    Returns what score.json holds, as a dict: figures (depth_mm, removed_mm3, ...), uncertainty, criteria,
    points_percent, passed, notes. Warnings on the inputs are UserWarnings. Ctrl-C ends the work between its stages.
    Raises Error for files that can't be read, teeth that don't match, an empty preparation; ValueError and TypeError
    for wrong arguments.
    """
    options = {"original": _path(original), "prepared": _path(prepared), "target": _path(target),
               "trace": _path(trace), "type": type, "axis": axis, "mesial": mesial, "buccal": buccal,
               "register": register, "voxel_mm": voxel_mm, "undercut_threshold_mm": undercut_threshold_mm,
               "force_limit_n": force_limit_n}
    with _hdf5_to_ourselves():
        return json.loads(_core.score(options, _path(rubric), os.path.join(data_folder(), "rubrics"),
                                      callback(progress)))


def render(tooth, output=None, *, view=None, size=(1200, 900), cut=None, zoom=1.0, centre_mm=None, samples=4,
           scale_bar=True, overwrite=True, progress=None):
    """A picture of a tooth, without a display.

    tooth      a Tooth, or the path of one
    output     .png, or .exr with depth, normal and tissue; None: only the arrays
    view       'oblique', 'occlusal', 'buccal', 'lingual', 'mesial', 'distal', 'apical', or 'X,Y,Z', the direction to
               look from; None: oblique, or straight at the cut
    size       (width, height), pixels
    cut        take away what is in front of a plane: a side through the middle ('mesial', ...), or 'X,Y,Z,NX,NY,NZ'
    zoom, centre_mm (3,), samples (per pixel, each way), scale_bar: as the options of `toothprep render`
    progress   True for a line on stderr, or a function called as progress(stage, done)

    Returns a dict: image (H, W, 3) uint8, depth_mm (H, W) float32 (infinite in the background), normal (H, W, 3) in W,
    tissue (H, W) uint8, view, mm_per_pixel, and the camera: camera_origin_mm, camera_right, camera_up,
    camera_forward (3,). Parallel projection: lengths across the picture are true. Raises Error if nothing remains of
    the tooth, or for options out of range.
    """
    options = {"view": view, "size": tuple(size), "cut": cut, "zoom": zoom, "centre_mm": centre_mm,
               "samples": samples, "scale_bar": scale_bar}
    loaded = tooth if isinstance(tooth, Tooth) else _core.load(tooth)
    return _core.render(loaded, _path(output), overwrite, options, callback(progress))
