#include "toothprep/tools/io/outputs.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <optional>
#include <stdexcept>
#include <system_error>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/io/folder_marker.h"
#include "toothprep/tools/io/part.h"
#include "toothprep/tools/io/path_lock.h"
#include "toothprep/tools/io/rename.h"
#include "toothprep/tools/io/write_file.h"

namespace toothprep {
namespace fs = std::filesystem;

// A file or folder as the system knows it, whatever its names.
struct Outputs::Input {
  std::string shown;
  fs::path place;
  struct stat status {};
};

struct Outputs::Output {
  std::string shown;
  Kind kind = Kind::kFile;
  fs::path place;                     // without links, absolute
  std::optional<struct stat> before;  // of what stood there at the beginning
  std::unique_ptr<Part> part;         // none of a growing one
  enum class State { kPart, kNew, kExchanged } state = State::kPart;
};

namespace {

// Of formats that are read or written somewhere, or that a user would miss.
constexpr std::array kKnownExtensions = {
    ".vdb",  ".h5",   ".hdf5", ".csv",  ".json", ".toml", ".ply",  ".stl", ".obj",  ".off", ".vtk",
    ".png",  ".exr",  ".jpg",  ".jpeg", ".tif",  ".tiff", ".gif",  ".svg", ".pdf",  ".md",  ".txt",
    ".nrrd", ".nhdr", ".nii",  ".gz",   ".mha",  ".mhd",  ".raw",  ".dcm", ".html", ".zip", ".py",
    ".cpp",  ".h",    ".m",    ".doc",  ".docx", ".xls",  ".xlsx", ".mat", ".ipynb"};

std::string lower(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return text;
}

std::string joined(const std::vector<std::string>& extensions) {
  std::string all;
  for (std::size_t i = 0; i < extensions.size(); ++i)
    all += (i == 0 ? "" : i + 1 == extensions.size() ? " or " : ", ") + extensions[i];
  return all;
}

// The extension of the file's name, as written; throws InputError for another format's. Where there
// are several formats the name chooses, so it must have one of them.
std::string extension_of(const std::string& shown, const std::vector<std::string>& extensions) {
  const std::string name = fs::path(shown).filename().string(), low = lower(name);
  std::string longest;
  for (const std::string& e : extensions)
    if (low.size() > e.size() && low.ends_with(e) && e.size() > longest.size()) longest = e;
  if (!longest.empty()) return name.substr(name.size() - longest.size());
  const std::string own = lower(fs::path(name).extension().string());
  const bool foreign =
      std::find(kKnownExtensions.begin(), kKnownExtensions.end(), own) != kKnownExtensions.end();
  if (foreign)
    throw InputError(shown, "", "has the extension of another format",
                     "this output is written as " + joined(extensions));
  if (extensions.size() > 1)
    throw InputError(shown, "", "does not say its format", "name it " + joined(extensions));
  return fs::path(name).extension().string();
}

std::optional<struct stat> status_of(const fs::path& path) {
  struct stat s {};
  if (stat(path.c_str(), &s) == 0) return s;
  return {};
}

// Where an output will stand, without links.
fs::path place_of(const std::string& shown) {
  fs::path path = shown;
  while (!path.has_filename() && path.has_relative_path()) path = path.parent_path();
  if (path.empty()) throw Error("an output needs a file name, got '" + shown + "'");
  std::error_code error;
  const fs::file_type type = fs::symlink_status(path, error).type();
  if (type == fs::file_type::not_found) {
    const fs::path folder = path.has_parent_path() ? path.parent_path() : fs::path(".");
    if (!fs::is_directory(folder, error))
      throw InputError(shown, "", "the folder '" + folder.string() + "' does not exist",
                       "create it first");
    return fs::canonical(folder) / path.filename();
  }
  fs::path place = fs::canonical(path, error);
  if (!error) return place;
  if (type == fs::file_type::symlink)
    throw InputError(shown, "", "is a link to nothing", "remove it or choose another name");
  throw InputError(shown, "", "cannot be reached: " + error.message());
}

void check_kind(const std::string& shown, const struct stat& s, bool folder, bool force) {
  if (folder && S_ISREG(s.st_mode))
    throw InputError(shown, "", "is a file", "a folder is to be written here");
  if (!folder && S_ISDIR(s.st_mode))
    throw InputError(shown, "", "is a folder", "a file is to be written here");
  if (!S_ISREG(s.st_mode) && !S_ISDIR(s.st_mode))
    throw InputError(shown, "", "is no regular file", "outputs go to files only");
  if (!force) throw InputError(shown, "", "exists already", "give --force to replace it");
}

void check_replaceable(const std::string& shown, const fs::path& folder) {
  if (const std::string why = not_ours(folder.string()); !why.empty())
    throw InputError(shown, "", why + ", so it is not replaced",
                     "remove the folder by hand or choose another");
}

void sync(const fs::path& path, const std::string& shown) {
  const int file = open(path.c_str(), O_RDONLY | O_CLOEXEC);
  const bool done = file >= 0 && (fsync(file) == 0 || errno == EINVAL || errno == EROFS);
  const int error = errno;
  if (file >= 0) close(file);
  if (!done) throw Error(shown + ": cannot be written: " + std::generic_category().message(error));
}

}  // namespace

bool lies_in(const fs::path& path, const fs::path& folder) {
  return std::mismatch(folder.begin(), folder.end(), path.begin(), path.end()).first ==
         folder.end();
}

Outputs::Outputs(bool force) : force_(force) {}
Outputs::~Outputs() = default;

void Outputs::reads(const std::vector<std::string>& paths) {
  for (const std::string& path : paths) {
    const auto status = status_of(path);
    std::error_code error;
    const fs::path place = status ? fs::canonical(path, error) : fs::path();
    if (status && !error) inputs_.push_back({path, place, *status});
  }
}

Outputs::Output& Outputs::add(const std::string& path, Kind kind,
                              const std::vector<std::string>& extensions) {
  auto output = std::make_unique<Output>();
  output->shown = path;
  output->kind = kind;
  output->place = place_of(path);
  output->before = status_of(output->place);
  const bool folder = kind == Kind::kFolder;
  if (output->before) check_kind(path, *output->before, folder, force_);
  const std::string extension = folder ? std::string() : extension_of(path, extensions);
  const fs::path parent = output->place.parent_path();
  if (folder && output->before) check_replaceable(path, output->place);
  if (!folder) refuse_if_locked(output->place, path);
  // Of a growing one only to see that the folder can be written.
  output->part = std::make_unique<Part>(parent, extension, path, folder);
  if (kind == Kind::kGrowing) output->part.reset();
  outputs_.push_back(std::move(output));
  return *outputs_.back();
}

std::string Outputs::file(const std::string& path, const std::vector<std::string>& extensions) {
  return add(path, Kind::kFile, extensions).part->path();
}

std::string Outputs::folder(const std::string& path) {
  return add(path, Kind::kFolder, {}).part->path();
}

std::string Outputs::optional_file(const std::string& path,
                                   const std::vector<std::string>& extensions) {
  return path.empty() ? std::string() : file(path, extensions);
}

std::string Outputs::optional_folder(const std::string& path) {
  return path.empty() ? std::string() : folder(path);
}

void Outputs::growing(const std::string& path, const std::vector<std::string>& extensions) {
  add(path, Kind::kGrowing, extensions);
}

void Outputs::check_against_inputs(const Output& output) const {
  if (!output.before) return;
  for (const Input& input : inputs_) {
    if (input.status.st_dev == output.before->st_dev &&
        input.status.st_ino == output.before->st_ino)
      throw InputError(output.shown, "", "is read as an input, too", "choose another name");
    if (output.kind == Kind::kFolder && lies_in(input.place, output.place))
      throw InputError(output.shown, "", "holds '" + input.shown + "', which is read",
                       "choose another folder");
    if (S_ISDIR(input.status.st_mode) && lies_in(output.place, input.place) &&
        output.kind != Kind::kFolder)
      throw InputError(output.shown, "", "lies in the folder '" + input.shown + "', which is read",
                       "choose another place");
  }
}

void Outputs::begin() {
  for (const auto& output : outputs_) {
    check_against_inputs(*output);
    for (const auto& other : outputs_) {
      if (other == output) continue;
      if (other->place == output->place)
        throw InputError(output->shown, "", "is named for two outputs", "name different files");
      if (other->kind == Kind::kFolder && lies_in(output->place, other->place))
        throw InputError(output->shown, "",
                         "lies in the folder '" + other->shown + "', which is written as a whole",
                         "choose another place");
    }
    remove_stale_parts(output->place.parent_path());
  }
  begun_ = true;
}

void Outputs::put_in_place(Output& output) const {
  const fs::path part = output.part->path();
  const auto failed = [&](int error) {
    return Error(output.shown + ": cannot be written: " + std::generic_category().message(error));
  };
  const int error = rename_to_new(part, output.place);
  if (error == 0) {
    output.state = Output::State::kNew;
    return;
  }
  if (error != EEXIST && error != ENOTEMPTY) throw failed(error);
  if (!force_)
    throw InputError(output.shown, "", "appeared while the command ran, so it is not replaced",
                     "give --force or choose another name");
  const bool folder = output.kind == Kind::kFolder;
  struct stat now {};
  if (lstat(output.place.c_str(), &now) == 0) check_kind(output.shown, now, folder, true);
  if (!folder) refuse_if_locked(output.place, output.shown);
  if (const int again = toothprep::exchange(part, output.place)) throw failed(again);
  output.state = Output::State::kExchanged;
  if (folder) check_replaceable(output.shown, part);  // what came into it while the command ran
}

void Outputs::take_back(Output& output) const {
  if (output.state == Output::State::kExchanged)
    toothprep::exchange(output.part->path(), output.place);
  if (output.state == Output::State::kNew) rename_to_new(output.place, output.part->path());
  output.state = Output::State::kPart;
}

void Outputs::publish() {
  if (!begun_) throw std::logic_error("outputs were not checked by begin()");
  for (const auto& output : outputs_) {
    if (!output->part) continue;
    const fs::path part = output->part->path();
    if (output->kind == Kind::kFolder) {
      mark_folder(part.string());
      for (const auto& entry : fs::recursive_directory_iterator(part))
        if (!entry.is_symlink()) sync(entry.path(), output->shown);
    } else if (fs::file_size(part) == 0) {
      throw Error(output->shown + ": nothing was written: " + why_not_written(part.string(), 0));
    }
    sync(part, output->shown);
  }
  const SignalsWait wait;
  try {
    for (const auto& output : outputs_)
      if (output->part) put_in_place(*output);
    for (const auto& output : outputs_)
      if (output->part) sync(output->place.parent_path(), output->shown);
  } catch (const std::exception&) {
    for (auto output = outputs_.rbegin(); output != outputs_.rend(); ++output)
      if ((*output)->part) take_back(**output);
    throw;
  }
  outputs_.clear();  // with what was replaced
}

}  // namespace toothprep
