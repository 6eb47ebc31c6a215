// SPDX-License-Identifier: MIT OR Apache-2.0
//
// Runs cocotb in Verilator 5.006 of Debian 12: that of cocotb 2.1 needs functions of later versions.

#include <memory>

#include "Vtop.h"
#include "verilated.h"
#include "verilated_vpi.h"

extern "C" void vlog_startup_routines_bootstrap();

namespace {

vluint64_t main_time = 0;

// Callbacks on changed values, which may change values.
bool Settle() {
  bool called = false;
  while (VerilatedVpi::callValueCbs()) called = true;
  return called;
}

}  // namespace

double sc_time_stamp() { return static_cast<double>(main_time); }

int main(int argc, char** argv) {
  Verilated::commandArgs(argc, argv);
  auto top = std::make_unique<Vtop>("");
  Verilated::fatalOnVpiError(false);
  vlog_startup_routines_bootstrap();
  VerilatedVpi::callCbs(cbStartOfSimulation);
  Settle();
  while (!Verilated::gotFinish()) {
    // All that happens at this time, until nothing does.
    for (bool again = true; again;) {
      top->eval_step();
      again = Settle();
      again |= VerilatedVpi::callCbs(cbReadWriteSynch);
      again |= Settle();
    }
    top->eval_end_step();
    VerilatedVpi::callCbs(cbReadOnlySynch);
    const vluint64_t next = VerilatedVpi::cbNextDeadline();
    if (next == ~vluint64_t{0}) break;
    main_time = next;
    VerilatedVpi::callCbs(cbNextSimTime);
    Settle();
    VerilatedVpi::callTimedCbs();
    Settle();
  }
  VerilatedVpi::callCbs(cbEndOfSimulation);
  top->final();
  return 0;
}
