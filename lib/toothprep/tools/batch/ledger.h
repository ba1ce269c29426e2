// What became of the items, a line each as they end: DIR/.batch/rows/*.rows.
//
// An index of the items' folders, so that 100 000 of them need not be read at each start: what
// counts is in the folders, and without the lines they are read. A line holds the size and time of
// every file of its item, and counts only while they are as they were (equal or not: clocks of
// different machines are never compared). Each process appends to a file of its own and rewrites
// nothing; a line that was cut off by a kill or a full disk is passed over.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "toothprep/tools/batch/item_figures.h"

namespace toothprep {

struct LedgerFile {
  std::string name;  // in the item's folder
  std::uint64_t size = 0;
  std::int64_t time = 0;  // of its last change, as the file system has it
};

struct LedgerEntry {
  std::string identity;  // digest of what the item was made of
  bool failed = false;
  std::string reason;  // of a failure, or the warnings
  double seconds = 0;  // that it took
  double memory = 0;   // bytes at most; 0: not known
  std::string node;    // where it ran
  std::vector<LedgerFile> files;
  // With SHA-256; also of outputs that were not kept.
  std::vector<std::pair<std::string, std::string>> outputs;
  ItemFigures figures;
};

class Ledger {
 public:
  // `own` names the file that this process appends to.
  Ledger(const std::filesystem::path& folder, const std::string& own);
  ~Ledger();
  Ledger(const Ledger&) = delete;
  Ledger& operator=(const Ledger&) = delete;

  // Reads the places of all lines anew, of all files.
  void load();
  // The lines of an item, the newest of each file last; without figures unless asked for.
  [[nodiscard]] std::vector<LedgerEntry> entries(const std::string& item, bool figures) const;
  // Throws Error if it can't be written.
  void append(const std::string& item, const LedgerEntry& entry);

  [[nodiscard]] bool knows(const std::string& item) const { return places_.count(item) > 0; }

 private:
  struct Place {
    std::uint32_t file = 0, length = 0;
    std::uint64_t at = 0;
  };
  int descriptor(std::uint32_t file) const;

  std::filesystem::path folder_, own_;
  std::vector<std::filesystem::path> files_;
  mutable std::vector<int> open_;  // of files_; -1: not yet
  std::unordered_map<std::string, std::vector<Place>> places_;
  int append_ = -1;
  std::uint64_t end_ = 0;  // of the own file
};

// All files of a folder as they are, by name.
std::vector<LedgerFile> files_now(const std::filesystem::path& folder);
// Whether the files that are named are as they were.
bool unchanged(const std::filesystem::path& folder, const std::vector<LedgerFile>& files);

}  // namespace toothprep
