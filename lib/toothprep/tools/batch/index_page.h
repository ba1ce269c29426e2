// The page of a batch: what was done, ranked, with pictures and links.
#pragma once

#include <string>

#include "toothprep/tools/batch/item_figures.h"

namespace toothprep {

// HTML, complete in itself but for the links to what lies in the items' folders below `folder`.
// Scores first, by points from the highest down (equal ones by name); then what has no points, in
// its order; of more than 2000 items the first 2000. The picture is report/thumbnail.png of the item's folder, where there is one.
std::string index_page(const ItemRows& rows, const std::string& folder, const std::string& version);

}  // namespace toothprep
