// The table of a batch as HDF5, with typed columns.
#pragma once

#include <string>

#include "toothprep/tools/batch/item_figures.h"

namespace toothprep {

// The rows and columns of batch.csv in the group `items`, a dataset per column. A column is int64
// where every row has a whole number that fits, float64 where cells are numbers (NaN for none), bool
// where every row has a truth value (float64 with 1, 0, NaN where not every row has one), else text.
// The attribute `units` of a column is that of its name (`_mm`, `_mm_s`). Two passes over the rows,
// which need not fit into memory. Throws Error.
void write_table_h5(const ItemRows& rows, const std::string& version, const std::string& build,
                    const std::string& path);

// "mm/s" of "sweep.feed_mm_s", "mm^3" of "removed_mm3.enamel", "mm" of "criteria.depth_mm.value";
// empty where the key names none.
std::string unit_of_key(const std::string& key);

}  // namespace toothprep
