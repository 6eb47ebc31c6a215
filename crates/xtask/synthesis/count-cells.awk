# Cell counts of a yosys `stat` report as: LUT logic, LUT memory, LUT shift register, FF, DSP, RAMB18, RAMB36. Of several sections
# the last counts, which is that of the whole design. Xilinx, ECP5 and Gowin: a carry cell of ECP5 has two tables, one of
# Gowin is one; a distributed memory of 16 x 4 bits takes three slices, six tables, of either; multipliers are counted in
# 18x18 there, of which one of 9x9 is half and one of 36x36 four.
function add(cell, number) {
  if (cell ~ /^LUT[1-6]$/ || cell == "INV" || cell == "ALU") logic_luts += number
  else if (cell == "CCU2C") logic_luts += 2 * number
  else if (cell == "TRELLIS_DPR16X4" || cell ~ /^RAM16SDP/) memory_luts += 6 * number
  else if (cell ~ /^RAM(32M|64M|256X1D|128X1D|256X1S)$/) memory_luts += 4 * number
  else if (cell ~ /^RAM(32X1D|64X1D|128X1S)$/) memory_luts += 2 * number
  else if (cell ~ /^RAM(32X1S|64X1S)$/) memory_luts += number
  else if (cell ~ /^SRL/) shift_luts += number
  else if (cell ~ /^FD/ || cell ~ /^DFF/ || cell == "TRELLIS_FF") flip_flops += number
  else if (cell ~ /^DSP48/ || cell ~ /^MULT18X18/) dsp += number
  else if (cell == "MULT9X9") dsp += number / 2
  else if (cell == "MULT36X36") dsp += 4 * number
  else if (cell ~ /^RAMB18/ || cell == "DP16KD" || cell == "PDPW16KD" || cell ~ /^(SP|SDP|SDPB|DP|DPB|SPX9|SDPX9B|DPX9B|pROM|pROMX9)$/) ramb18 += number
  else if (cell ~ /^RAMB36/) ramb36 += number
}
/design hierarchy/ { logic_luts = memory_luts = shift_luts = flip_flops = dsp = ramb18 = ramb36 = 0 }
$1 ~ /^[0-9]+$/ && $NF ~ /^[A-Za-z]/ { add($NF, $1) }
$1 ~ /^[A-Z]/ && $2 ~ /^[0-9]+$/ && NF == 2 { add($1, $2) }
END { print logic_luts + 0, memory_luts + 0, shift_luts + 0, flip_flops + 0, dsp + 0, ramb18 + 0, ramb36 + 0 }
