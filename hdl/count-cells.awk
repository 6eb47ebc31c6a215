# Cell counts of a yosys `stat` report as: LUT logic, LUT memory, LUT shift register, FF, DSP, RAMB18, RAMB36. Of several sections
# the last counts, which is that of the whole design.
function add(cell, number) {
  if (cell ~ /^LUT[1-6]$/ || cell == "INV") logic_luts += number
  else if (cell ~ /^RAM(32M|64M|256X1D|128X1D|256X1S)$/) memory_luts += 4 * number
  else if (cell ~ /^RAM(32X1D|64X1D|128X1S)$/) memory_luts += 2 * number
  else if (cell ~ /^RAM(32X1S|64X1S)$/) memory_luts += number
  else if (cell ~ /^SRL/) shift_luts += number
  else if (cell ~ /^FD/) flip_flops += number
  else if (cell ~ /^DSP48/) dsp += number
  else if (cell ~ /^RAMB18/) ramb18 += number
  else if (cell ~ /^RAMB36/) ramb36 += number
}
/design hierarchy/ { logic_luts = memory_luts = shift_luts = flip_flops = dsp = ramb18 = ramb36 = 0 }
$1 ~ /^[0-9]+$/ && $NF ~ /^[A-Z]/ { add($NF, $1) }
$1 ~ /^[A-Z]/ && $2 ~ /^[0-9]+$/ && NF == 2 { add($1, $2) }
END { print logic_luts + 0, memory_luts + 0, shift_luts + 0, flip_flops + 0, dsp + 0, ramb18 + 0, ramb36 + 0 }
