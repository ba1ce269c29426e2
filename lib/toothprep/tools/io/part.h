// The hidden file or folder in which an output is made, beside the place where it will appear.
#pragma once

#include <filesystem>
#include <string>

namespace toothprep {

struct PartEntry;

// Made empty by the constructor (Error if that fails), removed by the destructor with all that is
// in it, and removed, too, when SIGINT, SIGTERM, SIGHUP or the like ends the program: the first
// Part installs handlers for those that would end it without. Its name holds host, boot, process
// and the process's start time, so that what a killed process left can be known.
class Part {
 public:
  // `extension` (".nii.gz") ends the name of a file, since writers choose the format by it. `shown`
  // is what messages call it, see with_shown_names.
  Part(const std::filesystem::path& folder, const std::string& extension, const std::string& shown,
       bool is_folder);
  ~Part();
  Part(const Part&) = delete;
  Part& operator=(const Part&) = delete;

  const std::string& path() const { return path_; }

 private:
  std::string path_;
  PartEntry* entry_;
};

// Whether it is the name of a part of this process.
bool is_own_part(const std::string& name);

// Removes the parts in `folder` whose process no longer runs on this machine.
void remove_stale_parts(const std::filesystem::path& folder);

// In a forked child that goes on as a program of its own: the parts are its parent's.
void forget_parts();

// `text` with the parts of this process called by the names that the user gave.
std::string with_shown_names(std::string text);

// While it lives, a signal that would end the program waits.
class SignalsWait {
 public:
  SignalsWait();
  ~SignalsWait();
  SignalsWait(const SignalsWait&) = delete;
  SignalsWait& operator=(const SignalsWait&) = delete;
};

}  // namespace toothprep
