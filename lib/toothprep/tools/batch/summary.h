// What a sweep shows: quantiles of every figure, and how much each factor changes it.
#pragma once

#include <string>

#include "toothprep/tools/batch/item_figures.h"

namespace toothprep {

// A table in CSV. For each step and figure that is a number: a line `all` with count, mean, sd and
// quantiles (0.05, 0.25, 0.5, 0.75, 0.95) and the ends; and for each factor that the step depends on
// a line per level (a value; of more than 12 different numbers, one of six parts with equally many
// rows), with the share of the variance that lies between the levels (eta squared) and the main
// effect, the largest of the levels' means less the least. Figures that are the same in all rows
// have the line `all` only.
std::string summary_csv(const ItemRows& rows);

}  // namespace toothprep
