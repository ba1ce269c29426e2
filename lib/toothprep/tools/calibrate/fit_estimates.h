// Values with their uncertainty, from the residuals as they are at the solution.
#pragma once

#include "toothprep/tools/calibrate/fit_modes.h"
#include "toothprep/tools/calibrate/fit_solver.h"

namespace toothprep {

// Pieces of time that are drawn anew together: longer than the residuals' correlation.
struct Blocks {
  double correlation_time = 0, length = 0;  // s
  std::vector<Chunk> chunks;
  PerTissue<std::size_t> of_tissue{};  // that each tissue makes a force in
};
Blocks blocks_of(const Solution& solution, const FitOptions& options);

// Fills in, of the result: sensor and recordings.
struct BlockDraws {
  FreeSet free;
  Eigen::MatrixXd steps;  // free parameters x replicates
};
BlockDraws draw_blocks(const Solution& solution, const Asked& asked, const FitOptions& options);
void describe_sensor(const Solution& solution, const BlockDraws& draws, const Asked& asked,
                     FitResult& result);
// And: the further parameters.
void describe_shapes(const Solution& solution, const BlockDraws& draws, const Blocks& blocks,
                     FitResult& result);
// And: u and alpha per tissue, their correlation and draws.
void describe_tissues(const Solution& solution, const BlockDraws& draws, const Blocks& blocks,
                      FitResult& result);

}  // namespace toothprep
