#include "toothprep/tools/batch/claims.h"

#include <cerrno>
#include <fstream>
#include <optional>
#include <system_error>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/io/process_name.h"
#include "toothprep/tools/io/rename.h"
#include "toothprep/tools/io/write_file.h"

namespace toothprep {
namespace fs = std::filesystem;

namespace {

// Nothing if there is no claim; an owner of whom nothing is known if it can't be read.
std::optional<ClaimOwner> read_owner(const fs::path& path) {
  std::error_code error;
  std::ifstream in(path);
  if (!in && !fs::exists(path, error)) return {};
  ClaimOwner owner;
  in >> owner.process >> owner.job >> owner.restart;
  if (owner.job == "-") owner.job.clear();
  return owner;
}

}  // namespace

Claims::Claims(const fs::path& folder, ClaimOwner self,
               std::function<bool(const ClaimOwner&)> ended_elsewhere)
    : folder_(folder / ".batch" / "claims"),
      self_(std::move(self)),
      ended_elsewhere_(std::move(ended_elsewhere)) {
  std::error_code error;
  fs::create_directories(folder_, error);
  if (error) throw Error(folder_.string() + ": cannot be made: " + error.message());
}

fs::path Claims::place(const std::string& item, int n) const {
  return folder_ / (item + "." + std::to_string(n));
}

bool Claims::ended(const ClaimOwner& owner) const {
  switch (process_state(owner.process)) {
    case ProcessState::kRuns:
      return false;
    case ProcessState::kEnded:
      return true;
    case ProcessState::kUnknown:
      break;
  }
  // The scheduler ends a job before it begins it anew.
  if (!owner.job.empty() && owner.job == self_.job && owner.restart < self_.restart) return true;
  return ended_elsewhere_ && ended_elsewhere_(owner);
}

Claims::Answer Claims::take(const std::string& item) {
  if (mine_.count(item)) return Answer::kMine;
  for (int n = 0;;) {
    if (const auto owner = read_owner(place(item, n))) {
      if (!ended(*owner)) return Answer::kHeld;
      ++n;
      continue;
    }
    const fs::path fresh = folder_ / ("." + self_.process + ".new");
    write_file(fresh.string(), self_.process + " " + (self_.job.empty() ? "-" : self_.job) + " " +
                                   std::to_string(self_.restart) + "\n");
    const int error = rename_to_new(fresh, place(item, n));
    if (error == 0) {
      mine_[item] = n;
      return Answer::kMine;
    }
    fs::remove(fresh);
    if (error != EEXIST)
      throw Error(place(item, n).string() +
                  ": cannot be written: " + std::generic_category().message(error));
  }
}

void Claims::release(const std::string& item) {
  const auto found = mine_.find(item);
  if (found == mine_.end()) return;
  std::error_code error;
  fs::remove(place(item, found->second), error);
  mine_.erase(found);
}

bool Claims::held(const std::string& item) const {
  for (int n = 0;; ++n) {
    const auto owner = read_owner(place(item, n));
    if (!owner) return false;
    if (!ended(*owner)) return true;
  }
}

}  // namespace toothprep
