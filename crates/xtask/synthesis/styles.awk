# Puts the attributes of memories into Verilog that GHDL made of a network, because GHDL 2.0 hands no attribute on:
#
#   ghdl --synth --std=08 --out=verilog NAME | awk -f crates/xtask/synthesis/styles.awk > NAME.v
#
# Depths at which memories become block RAM are those of pe_style_pkg.vhd. `no_rw_check` is right, because no word is
# read in the clock that writes it.
#
# Sums in front of multipliers become signed ones: GHDL writes the others, which are the same as long as all widths are, but
# yosys 0.70 hands their operands to the wider pre-adder of a DSP48E1 without their signs.
{ line[NR] = $0 }
/^module / { module = $2 }
module ~ /^pe_multiplier/ && /^ *assign [a-z0-9_]+ = [a-z0-9_]+ \+ [a-z0-9_]+;$/ {
  sub(/;$/, "")
  line[NR] = "  assign " $2 " = $signed(" $4 ") + $signed(" $6 ");"
}
$1 ~ /^pe_rom/ && $2 ~ /^u_variants/ { tables[$1] = 1 }
/\/\/ memory$/ {
  # "reg [19:0] n39[127:0] ; // memory": 20 bits, 128 words
  declaration = $0
  gsub(/[^0-9]+/, " ", declaration)
  count = split(declaration, number, " ")
  bits[NR] = number[1] + 1
  words[NR] = number[count - 1] + 1
  owner[NR] = module
}
END {
  for (i = 1; i <= NR; i++) {
    if (i in words) {
      if (owner[i] ~ /^pe_rom/) {
        # No attribute would let a memory for tables be a block.
        block = words[i] > 64 && !(owner[i] in tables)
        printf "  (* rom_style = \"%s\" *)\n", block ? "block" : "logic"
      } else {
        block = words[i] > 128 || (words[i] == 128 && bits[i] <= 36)
        # Not "distributed": a memory that is never written would then have no place on ECP5 and Gowin.
        printf "  (* %sno_rw_check *)\n", block ? "ram_style = \"block\", " : ""
      }
    }
    print line[i]
  }
}
