// Surface scans as they come, to shells that bound a solid: one tooth cut out, bad places mended,
// the open side closed. Everything that is done is named with its place and size.
//
// What is mended: faces without area or given twice, points of a seam less than 2 um apart, flipped
// faces, fins and faces that share an edge with two others, faces that intersect (in spots of up to
// 3 mm: more, or more than 2 % of all, is no damage but another shape), loose pieces below 1 % of the
// largest part's area.
// What is missing after that are openings. One of up to 3 mm (and 40 % of the whole) is a hole: it is filled by a surface
// that continues the one around it (CGAL's refined and faired patch). One wider opening per part is
// the open side, a crown's neck: it is closed by a plane where its rim is flat within 0.1 mm, else
// by a base, walls from the rim straight to a plane beyond it. Refused is what would be an
// invention: a second wide opening, a rim that strays from its plane by more than a third of its
// width, a piece that is nearly flat.
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "toothprep/tools/shells/shells.h"

namespace toothprep {

struct ShellReading {                 // what to take of a mesh file, and how
  std::optional<double> mm_per_unit;  // of its coordinates; absent: mm
  std::optional<Box> roi;             // mm: only what lies in it, and of that the largest part
  int tooth = 0;                      // the n-th largest part; 0: all
  std::optional<Vec3> tooth_at;       // mm: the part nearest to this place; wins over `tooth`
  bool mend = true;                   // and close; else faults are refused
  double base_mm = 0;                 // how far an open side is continued by walls at least
};

// Where an open scan ended and a base was added.
struct OpenSide {
  Vec3 centre = Vec3::Zero(), outward = Vec3::UnitZ();  // mm; of the rim's plane, off the tooth
  std::vector<Vec3> rim;                                // mm, in order
  double lowest = 0, highest = 0;                       // mm: of the rim, along `outward`

  // Whether the scan knows nothing of the place: it lies beyond the rim.
  [[nodiscard]] bool beyond(const Vec3& x) const;
};

struct SoundShell {                  // without faults
  Shell shell;                       // closed, faces outward
  std::vector<char> added;           // per triangle: 1 if it belongs to a base, not to the scan
  std::vector<OpenSide> open_sides;  // where bases were added
  std::vector<std::string> notes;    // what was done, one clause each
};

// The shell, mended and closed. Throws InputError with its file and its faults if that would be an
// invention.
[[nodiscard]] SoundShell close_shell(Shell shell, double base_mm = 0);

// The file's, or the part of it that is asked for. Throws InputError as read_shell() and
// close_shell() do, and for a part that is not there.
[[nodiscard]] SoundShell read_sound_shell(const std::string& path, const ShellReading& how);

// The tooth of the files, each of another tissue, read as `how` says. `notes` gets what was mended
// too. Provenance gets source (the files' names) and source_sha256 (over the SHA-256 of each).
// Throws InputError as read_sound_shell() and Error as voxelize_shells() do.
[[nodiscard]] LayeredTooth voxelize_shell_files(
    const std::vector<std::pair<Tissue, std::string>>& files, const ShellReading& how,
    const ShellOptions& options, std::vector<std::string>& notes);

// The same of several teeth: the files of each body make a tooth (`parts[i]` is the body's of the
// list), laid side by side.
[[nodiscard]] LayeredTooth voxelize_shell_bodies(
    const std::vector<Body>& list,
    const std::vector<std::vector<std::pair<Tissue, std::string>>>& parts, const ShellReading& how,
    const ShellOptions& options, std::vector<std::string>& notes);

// The tooth of one file without layers, by enamel_model(); provenance likewise, and enamel_model_mm.
[[nodiscard]] LayeredTooth voxelize_bare_shell(const std::string& file, double enamel_mm,
                                               const ShellReading& how, const ShellOptions& options,
                                               std::vector<std::string>& notes);

// Only what lies in the box (mm); triangles are cut at its sides. May be empty.
[[nodiscard]] Shell clipped(const Shell& shell, const Box& box);

struct ShellPart {            // what hangs together by edges
  Box bounds;                 // mm
  double area_mm2 = 0;        // of its faces
  double volume_mm3 = 0;      // of a closed one; negative if its faces look inward
  bool closed = false;        // no border edge
  std::size_t triangles = 0;  // how many
};
struct ShellOpening {            // border edges that hang together
  Vec3 centre = Vec3::Zero();    // mm
  double width = 0, length = 0;  // mm: its widest extent; of its rim
  std::size_t edges = 0;         // of its rim
};
struct ShellSurvey {                   // of a mesh as it is
  std::vector<ShellPart> parts;        // the largest area first
  std::vector<ShellOpening> openings;  // the widest first
};
// The parts and openings of a shell; changes nothing.
[[nodiscard]] ShellSurvey survey_shell(const Shell& shell);

// Layers for a shell that has none: a MODEL, not a measurement. Within thickness_mm of the scanned
// surface is enamel, deeper is dentin; there is no pulp. Towards an open side the enamel thins out:
// with h the height of the nearest point of the surface above the rim and H that of the highest,
// the thickness is thickness_mm * min(1, 2 h / H). Without an open side it is the same everywhere.
// `notes` gets the model's words. Throws Error as voxelize_shells() does.
[[nodiscard]] LayeredTooth enamel_model(const SoundShell& sound, double thickness_mm,
                                        const ShellOptions& options,
                                        std::vector<std::string>& notes);

}  // namespace toothprep
