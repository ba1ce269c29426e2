#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <limits>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/hash.h"
#include "toothprep/step/tooth/combine_teeth.h"
#include "toothprep/tools/shells/closing.h"
#include "toothprep/tools/shells/shell_topology.h"

namespace toothprep {
namespace {

constexpr double kToothArea = 60;  // mm², less than any crown's surface has

std::string joined(const std::vector<std::string>& texts, const char* separator) {
  std::string all;
  for (const auto& text : texts) all += (all.empty() ? "" : separator) + text;
  return all;
}

std::string place_of(const ShellPart& part) {
  const Vec3 middle = 0.5 * (part.bounds.min + part.bounds.max),
             size = part.bounds.max - part.bounds.min;
  std::string text = fmt::format("{:.1f} x {:.1f} x {:.1f} mm at {:.1f},{:.1f},{:.1f}", size.x(),
                                 size.y(), size.z(), middle.x(), middle.y(), middle.z());
  if (part.closed) text += fmt::format(", {:.0f} mm3", std::abs(part.volume_mm3));
  return text;
}

// "1: 9.8 x 9.1 x 7.2 mm at 1.0,2.0,3.0, 312 mm3; 2: ..."
std::string list_of(const std::vector<ShellPart>& parts, std::size_t most) {
  std::vector<std::string> texts;
  for (std::size_t p = 0; p < std::min(parts.size(), most); ++p)
    texts.push_back(std::to_string(p + 1) + ": " + place_of(parts[p]));
  if (parts.size() > most)
    texts.push_back("and " + std::to_string(parts.size() - most) + " smaller ones");
  return joined(texts, "; ");
}

std::size_t nearest_part(const Shell& shell, const shell_topology::Parts& parts,
                         const Vec3& place) {
  double nearest = std::numeric_limits<double>::infinity();
  std::size_t part = 0;
  for (std::size_t t = 0; t < shell.triangles.size(); ++t)
    for (const std::uint32_t p : shell.triangles[t])
      if (const double square = (shell.points[p] - place).squaredNorm(); square < nearest) {
        nearest = square;
        part = parts.of[t];
      }
  return part;
}

// One part and what its box encloses (a cavity inside it).
Shell only_part(const Shell& shell, const std::vector<ShellPart>& parts,
                const std::vector<std::uint32_t>& part_of, std::size_t chosen) {
  const Box& box = parts[chosen].bounds;
  std::vector<char> wanted(parts.size());
  for (std::size_t p = 0; p < parts.size(); ++p)
    wanted[p] = (parts[p].bounds.min.array() >= box.min.array()).all() &&
                (parts[p].bounds.max.array() <= box.max.array()).all();
  std::vector<char> keep(shell.triangles.size());
  for (std::size_t t = 0; t < keep.size(); ++t) keep[t] = wanted[part_of[t]];
  return shell_topology::kept_faces(shell, keep);
}

// What is asked for of several teeth; `notes` gets what else there is.
Shell chosen_part(Shell shell, const ShellReading& how, std::vector<std::string>& notes) {
  const std::string& path = shell.file;
  if (how.roi) {
    if (!((how.roi->max - how.roi->min).minCoeff() > 0))
      throw Error("--roi: the lower corner is not below the upper one");
    Shell inside = clipped(shell, *how.roi);
    if (inside.triangles.empty())
      throw InputError(
          path, "",
          "has nothing in the box of --roi; it holds " + list_of(survey_shell(shell).parts, 5));
    shell = std::move(inside);
  }
  const auto parts = shell_topology::parts_of(shell, shell_topology::half_edges(shell));
  const std::vector<ShellPart> found = survey_shell(shell).parts;
  std::size_t chosen = 0;
  if (how.tooth_at) {
    chosen = nearest_part(shell, parts, *how.tooth_at);
  } else if (how.tooth > 0) {
    chosen = static_cast<std::size_t>(how.tooth - 1);
    if (chosen >= found.size())
      throw InputError(
          path, "",
          "--tooth " + std::to_string(how.tooth) + " is not there; it holds " + list_of(found, 12));
  } else if (!how.roi) {
    const auto large = static_cast<std::size_t>(std::count_if(
        found.begin(), found.end(), [](const ShellPart& p) { return p.area_mm2 > kToothArea; }));
    if (large > 1)
      notes.push_back("all of its parts are taken, " + std::to_string(large) +
                      " of a tooth's size; --tooth takes one: " + list_of(found, large));
    return shell;
  }
  if (found.size() == 1) return shell;
  notes.push_back("took part " + std::to_string(chosen + 1) + " of " +
                  std::to_string(found.size()) + ": " + list_of(found, 12));
  return only_part(shell, found, parts.of, chosen);
}

void note_small_size(const Shell& shell, const ShellReading& how, std::vector<std::string>& notes) {
  if (how.mm_per_unit) return;
  Vec3 low = shell.points[0], high = low;
  for (const Vec3& p : shell.points) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  const double longest = (high - low).maxCoeff();
  if (const MeshUnit* unit = likely_mesh_unit(longest))
    notes.push_back(
        fmt::format("its longest side is {:.3g} mm, or {:.3g} mm if the file is in {}: "
                    "--length-unit {} says so, --length-unit mm that it is right",
                    longest, longest * unit->mm, unit->word, unit->name));
}

std::string sha256_of_all(const std::vector<std::string>& files) {
  Sha256 all;
  for (const std::string& file : files) {
    const std::string one = sha256_of_file(file);
    all.update(one.data(), one.size());
  }
  return all.hex();
}

std::string name_of(const std::string& file) {
  return std::filesystem::path(file).filename().string();
}

}  // namespace

SoundShell read_sound_shell(const std::string& path, const ShellReading& how) {
  Shell shell = read_shell(path, how.mm_per_unit);
  std::vector<std::string> notes;
  note_small_size(shell, how, notes);
  shell = chosen_part(std::move(shell), how, notes);
  SoundShell sound;
  if (how.mend) {
    sound = close_shell(std::move(shell), how.base_mm);
  } else {
    if (const auto faults = shell_faults(shell); !faults.empty())
      throw InputError(path, "", "does not bound a solid: " + joined(faults, "; "),
                       "without --no-repair small faults are mended and open sides closed");
    sound.added.assign(shell.triangles.size(), 0);
    sound.shell = std::move(shell);
  }
  sound.notes.insert(sound.notes.begin(), notes.begin(), notes.end());
  return sound;
}

LayeredTooth voxelize_shell_files(const std::vector<std::pair<Tissue, std::string>>& files,
                                  const ShellReading& how, const ShellOptions& options,
                                  std::vector<std::string>& notes) {
  if (files.size() > 1 && how.tooth > 0 && !how.tooth_at)
    throw Error("--tooth N takes a single mesh; of several give a place in the tooth, X,Y,Z");
  std::vector<TissueShell> shells;
  std::vector<std::string> names, paths;
  for (const auto& [tissue, file] : files) {
    if (options.progress) options.progress("reading and checking", 0);
    SoundShell sound = read_sound_shell(file, how);
    for (const std::string& note : sound.notes) notes.push_back(file + ": " + note);
    shells.push_back({tissue, std::move(sound.shell)});
    names.push_back(name_of(file));
    paths.push_back(file);
  }
  LayeredTooth tooth = voxelize_shells(shells, options, &notes);
  tooth.provenance["source"] = joined(names, ", ");
  tooth.provenance["source_sha256"] = sha256_of_all(paths);
  return tooth;
}

LayeredTooth voxelize_shell_bodies(
    const std::vector<Body>& list,
    const std::vector<std::vector<std::pair<Tissue, std::string>>>& parts, const ShellReading& how,
    const ShellOptions& options, std::vector<std::string>& notes) {
  check_bodies(list);
  std::vector<LayeredTooth> teeth;
  std::vector<std::string> names, paths;
  for (const auto& files : parts) {
    teeth.push_back(voxelize_shell_files(files, how, options, notes));
    for (const auto& [tissue, file] : files) {
      names.push_back(name_of(file));
      paths.push_back(file);
    }
  }
  LayeredTooth tooth = combine_teeth(teeth, list);
  tooth.provenance["source"] = joined(names, ", ");
  tooth.provenance["source_sha256"] = sha256_of_all(paths);
  return tooth;
}

LayeredTooth voxelize_bare_shell(const std::string& file, double enamel_mm, const ShellReading& how,
                                 const ShellOptions& options, std::vector<std::string>& notes) {
  if (options.progress) options.progress("reading and checking", 0);
  SoundShell sound = read_sound_shell(file, how);
  for (const std::string& note : sound.notes) notes.push_back(file + ": " + note);
  std::vector<std::string> of_model;
  LayeredTooth tooth = enamel_model(sound, enamel_mm, options, of_model);
  for (const std::string& note : of_model) notes.push_back(file + ": " + note);
  tooth.provenance["source"] = name_of(file);
  tooth.provenance["source_sha256"] = sha256_of_all({file});
  tooth.provenance["enamel_model_mm"] = fmt::format("{:.6g}", enamel_mm);
  return tooth;
}

}  // namespace toothprep
