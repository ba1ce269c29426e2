// A batch as text for other programs that run many commands: GNU parallel, xargs, Snakemake.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "toothprep/tools/batch/manifest.h"
#include "toothprep/tools/batch/run_batch.h"

namespace toothprep {

// The program with the arguments of an item; `path_of` gives the files that are other items'
// outputs.
std::vector<std::string> item_command(const BatchManifest& manifest, std::size_t item,
                                      const BatchOptions& options,
                                      const std::function<std::string(const BatchInput&)>& path_of);

// The items by the length of the longest chain of items that each needs. Of those that are given
// alone; needs that are not among them count as done.
std::vector<std::vector<std::size_t>> items_by_level(const BatchManifest& manifest,
                                                     const std::vector<std::size_t>& items);

// A line of sh for each item, which makes the item's folder below the options' folder (it must not
// be there) and what the command writes in it. Lines stand in the order of items_by_level(), with a
// comment `# level N: ...` before each level. What is not kept stays. Throws Error for an item that
// can't be a line (a line end in an argument).
std::string shell_commands(const BatchManifest& manifest, const BatchOptions& options);

// A Snakefile with a rule for each item, of the same folders and files; what is not kept is
// temp(). Throws Error like shell_commands(), and for a path with a brace.
std::string snakefile(const BatchManifest& manifest, const BatchOptions& options);

}  // namespace toothprep
