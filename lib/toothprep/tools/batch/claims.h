// Which process works on which item, where several share a folder: DIR/.batch/claims/ITEM.N.
//
// A claim is a file that is made whole beside its place and renamed there, which only one process
// can do. The claim of a process that has ended is never moved or removed: the next one takes N + 1,
// again only one of them. So no decision depends on a clock, and none is taken back. Whether an
// owner still works is asked of this machine if it is its own, else of the scheduler; an owner of
// which nothing is known keeps the item.
#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <string>

namespace toothprep {

struct ClaimOwner {
  std::string process;  // process_name()
  std::string job;      // of the scheduler; empty: none
  int restart = 0;      // how often the job was begun anew
};

class Claims {
 public:
  enum class Answer { kMine, kHeld };

  // `ended_elsewhere`: that an owner on another machine no longer works. Owners of this machine are
  // looked up here.
  Claims(const std::filesystem::path& folder, ClaimOwner self,
         std::function<bool(const ClaimOwner&)> ended_elsewhere);

  // Throws Error if nothing can be written.
  Answer take(const std::string& item);
  void release(const std::string& item);
  // Whether somebody holds it.
  [[nodiscard]] bool held(const std::string& item) const;

 private:
  [[nodiscard]] std::filesystem::path place(const std::string& item, int n) const;
  [[nodiscard]] bool ended(const ClaimOwner& owner) const;

  std::filesystem::path folder_;
  ClaimOwner self_;
  std::function<bool(const ClaimOwner&)> ended_elsewhere_;
  std::map<std::string, int> mine_;
};

}  // namespace toothprep
