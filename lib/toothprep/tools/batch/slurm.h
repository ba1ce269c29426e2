// A batch on a cluster with Slurm: job arrays of workers that share DIR, and what watches them.
//
// A round is a set of array jobs, one for each depth of the items' needs, each begun when the one
// before it has ended, whatever became of it; each task of an array is a worker (run_batch with
// claims) on a list of items. A last job, the collector, begins when all of them have ended: it
// writes the tables if everything has ended, else it submits the next round for the items that are
// left (a node failed, a job was preempted or cancelled, ran out of time or memory), asking for more
// where that was the cause. So nobody has to stay logged in. When, where and in which order jobs run
// is Slurm's business alone.
#pragma once

#include <string>
#include <vector>

#include "toothprep/tools/batch/claims.h"
#include "toothprep/tools/batch/manifest.h"
#include "toothprep/tools/batch/run_batch.h"

namespace toothprep {

struct SlurmOptions {
  std::string partition, account;
  std::vector<std::string> lines;  // further options of sbatch, "--constraint=fast"
  double minutes = 60;             // asked for, for a task
  double memory_mb = 1000;         // for each of its processors
  std::size_t items_per_task = 0;  // 0: as many as are known to take ten minutes; else 1/200 of all
  // The command line of this batch (program, batch, manifest, -o, DIR, ...), with absolute paths.
  std::vector<std::string> command;
};

// Submits the first round; what it will do, in words. Throws Error: no Slurm, refused, jobs of this
// folder are still under way. Needs no folder lock; nothing runs here.
std::string submit_to_slurm(const BatchManifest& manifest, const BatchOptions& options,
                            const SlurmOptions& slurm);

// What the collector does: true if all has ended and the tables are written, with `result`.
bool collect_from_slurm(const BatchManifest& manifest, const BatchOptions& options,
                        const SlurmOptions& slurm, BatchResult& result);

// A line on the jobs that are under way; empty without any.
std::string slurm_status(const std::string& folder);
// Jobs of the folder's last round that Slurm has not ended; -1: it gives no answer, or none was
// submitted.
int slurm_jobs(const std::string& folder);
// Whether the tables of the last round are written.
bool slurm_complete(const std::string& folder);

// In a worker whose items were killed: the next round asks for more memory. Throws Error.
void note_killed(const std::string& folder, const BatchManifest& manifest,
                 const std::vector<std::size_t>& items);

// The claims' owner: this process in its Slurm job, if it is in one.
ClaimOwner slurm_owner();
// Whether Slurm says that an owner's job has ended, or was begun anew since.
bool ended_by_slurm(const ClaimOwner& owner);

}  // namespace toothprep
