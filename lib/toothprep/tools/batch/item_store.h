// The items' folders: what an item is made of, whether it is done, and how it is put in place.
#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>

#include "toothprep/tools/batch/item_figures.h"
#include "toothprep/tools/batch/ledger.h"
#include "toothprep/tools/batch/manifest.h"

namespace toothprep {

// How the command of an item ended.
struct ItemEnd {
  std::string reason;  // why it failed; empty: it didn't
  double seconds = 0;
  double memory = 0;  // bytes at most; 0: not known
};

class ItemStore {
 public:
  // `folder`: DIR, absolute. `version` is part of what an item is made of, `build` is noted only.
  // `read_only`: what is found in folders is not noted in the ledger (others will have done so).
  ItemStore(const BatchManifest& manifest, const std::filesystem::path& folder,
            const std::string& version, const std::string& build, Ledger& ledger, bool read_only)
      : m_(manifest),
        dir_(folder),
        version_(version),
        build_(build),
        ledger_(ledger),
        read_only_(read_only) {}

  [[nodiscard]] std::filesystem::path folder_of(std::size_t i) const {
    return dir_ / m_.items[i].folder;
  }
  // Where an input lies, also one that is another item's output.
  [[nodiscard]] std::string path_of(const BatchInput& input) const;

  // The JSON text of what must be the same for an item to be done: command line, SHA-256 of inputs
  // and filled texts, version. What the item needs must be done. Inputs are hashed once.
  std::string identity_of(std::size_t i);

  // How the item stands, if it is done or failed for that identity. `fresh`: by its folder alone.
  std::optional<LedgerEntry> ended(std::size_t i, const std::string& identity, bool fresh = false);
  // The last that is known, for whatever identity.
  std::optional<LedgerEntry> last(std::size_t i, bool figures = false) const;

  // Writes the texts that are filled in.
  void fill(std::size_t i, const std::filesystem::path& part) const;

  // Puts what is in `part` in place, or of a failed item the log and why. The files that the item
  // doesn't keep are removed unless `all`. Never throws: what goes wrong is a failure.
  ItemRow put(std::size_t i, const std::filesystem::path& part, const std::string& identity,
              const ItemEnd& end, bool all);

  // Removes what the item doesn't keep.
  void drop(std::size_t i);

  [[nodiscard]] ItemRow row(std::size_t i, const LedgerEntry& entry) const;

  // Throws InputError if a folder of an item's, or a file in one, was not written by a batch, or
  // holds what is read. `all`: also where the ledger knows the folder.
  void check_folders(bool all);

  // Of the item's log: its warnings, or the last line.
  static std::string last_line(const std::filesystem::path& log);

 private:
  std::string hash_of(const BatchInput& input);
  std::optional<LedgerEntry> read_folder(std::size_t i, const std::string& identity) const;
  void write_failed(std::size_t i, const std::filesystem::path& part, const std::string& identity,
                    const std::string& reason, const ItemEnd& end);
  void write_done(std::size_t i, const std::filesystem::path& part, const std::string& identity,
                  const ItemEnd& end, bool all, ItemRow& row);
  void replace(std::size_t i, const std::filesystem::path& part) const;
  void note(std::size_t i, LedgerEntry entry);

  const BatchManifest& m_;
  std::filesystem::path dir_;
  std::string version_, build_;
  Ledger& ledger_;
  bool read_only_;
  std::map<std::size_t, LedgerEntry> found_;   // that isn't noted
  std::map<std::string, std::string> hashes_;  // of inputs, by path
};

}  // namespace toothprep
