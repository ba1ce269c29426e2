#include "toothprep/tools/batch/batch_plan.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <map>

#include "toothprep/tools/batch/ledger.h"
#include "toothprep/tools/io/memory_limit.h"
#include "toothprep/tools/io/part.h"

namespace toothprep {
namespace {

std::string duration_text(double seconds) {
  if (seconds < 120) return fmt::format("{:.1f} s", seconds);
  if (seconds < 7200) return fmt::format("{:.0f} min", seconds / 60);
  return fmt::format("{:.1f} h", seconds / 3600);
}

}  // namespace

std::vector<BatchKind> trial_of(const BatchManifest& manifest, const BatchOptions& options) {
  std::map<std::string, std::size_t> place;
  std::vector<BatchKind> kinds;
  for (std::size_t i = 0; i < manifest.items.size(); ++i) {
    const BatchItem& item = manifest.items[i];
    const std::string& command = manifest.commands[item.command].name;
    const auto [at, fresh] = place.try_emplace(item.step + "\n" + command, kinds.size());
    if (fresh)
      kinds.push_back({item.step.empty() ? "items" : item.step, command, 0, i, 0, 0, 0, 0, ""});
    ++kinds[at->second].items;
  }
  const Part folder(std::filesystem::temp_directory_path(), "", "the trial's folder", true);
  BatchOptions trial = options;
  trial.folder = folder.path();
  trial.at_once = 1;
  trial.redo = false;
  trial.progress = {};
  trial.warn = {};
  trial.selection = {};
  trial.selection.names.emplace();
  // What the tried items need runs too; all files stay, to be measured.
  BatchManifest keeping = manifest;
  std::vector<std::size_t> open;
  for (const BatchKind& kind : kinds) open.push_back(kind.first);
  std::vector<bool> seen(manifest.items.size(), false);
  while (!open.empty()) {
    const std::size_t i = open.back();
    open.pop_back();
    if (seen[i]) continue;
    seen[i] = true;
    keeping.items[i].keep = BatchKeep::kAll;
    trial.selection.names->push_back(manifest.items[i].name);
    open.insert(open.end(), manifest.items[i].needs.begin(), manifest.items[i].needs.end());
  }
  const BatchResult result = run_batch(std::move(keeping), trial);
  std::map<std::string, std::string> failures;
  for (const ItemRow& row : result.rows)
    if (row.failed()) failures[row.name] = row.reason;
  for (BatchKind& kind : kinds) {
    const BatchItem& item = manifest.items[kind.first];
    kind.seconds = result.seconds[kind.first];
    kind.memory = result.memory[kind.first];
    if (const auto failed = failures.find(item.name); failed != failures.end()) {
      kind.failure = failed->second;
      continue;
    }
    for (const LedgerFile& file : files_now(std::filesystem::path(trial.folder) / item.folder)) {
      const auto size = static_cast<double>(std::max<std::uint64_t>(file.size, 4096));
      kind.bytes_written += size;
      if (keeps(item.keep, file.name)) kind.bytes += size;
    }
  }
  return kinds;
}

std::string plan_text(const BatchManifest& manifest, const std::vector<BatchKind>& kinds,
                      int at_once, double free_disk) {
  std::string text = fmt::format("{} items", manifest.items.size());
  if (manifest.points > 0) text += fmt::format(", {} points of the sweep", manifest.points);
  text += fmt::format("\n{:<16} {:<20} {:>8} {:>12} {:>10} {:>12}\n", "step", "command", "items",
                      "time each", "memory", "disk each");
  double seconds = 0, bytes = 0, memory = 0;
  for (const BatchKind& kind : kinds) {
    text += fmt::format("{:<16} {:<20} {:>8} {:>12} {:>10} {:>12}\n", kind.name, kind.command,
                        kind.items, duration_text(kind.seconds), size_text(kind.memory),
                        size_text(kind.bytes));
    if (!kind.failure.empty())
      text +=
          "  the trial of " + manifest.items[kind.first].name + " failed: " + kind.failure + "\n";
    const auto count = static_cast<double>(kind.items);
    seconds += count * kind.seconds;
    bytes += count * kind.bytes;
    memory = std::max(memory, kind.memory);
  }
  if (bytes > free_disk)
    text += fmt::format(
        "the disk won't do: {} are free; keep less of each (keep in the manifest), or give a "
        "folder on another disk\n",
        size_text(free_disk));
  return text + fmt::format(
                    "about {} with {} at a time, {} of memory each, {} on disk; by one item of "
                    "each kind\n",
                    duration_text(seconds / std::max(1, at_once)), at_once, size_text(memory),
                    size_text(bytes));
}

}  // namespace toothprep
