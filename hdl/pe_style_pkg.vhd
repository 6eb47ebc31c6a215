-- SPDX-License-Identifier: MIT OR Apache-2.0

-- Attributes that tell synthesis where to put memories and products. Each tool reads its own and ignores the others: Vivado
-- and ISE `rom_style`, `ram_style`, `use_dsp`, `use_dsp48`; Synplify, Diamond, Radiant and Gowin `syn_romstyle`,
-- `syn_ramstyle`, `syn_multstyle`, `syn_dspstyle`; Quartus `romstyle`, `ramstyle`, `multstyle`. GHDL 2.0 hands none on:
-- `crates/xtask/synthesis/styles.awk` puts those of memories into its Verilog, by the same depths.

package pe_style_pkg is

  attribute rom_style    : string;
  attribute ram_style    : string;
  attribute use_dsp      : string;
  attribute use_dsp48    : string;
  attribute romstyle     : string;
  attribute ramstyle     : string;
  attribute multstyle    : string;
  attribute syn_romstyle : string;
  attribute syn_ramstyle : string;
  attribute syn_multstyle : string;
  attribute syn_dspstyle : string;

  -- Memories without a write port of more words are block RAM.
  constant TABLE_ROM_WORDS : positive := 64;

  -- Memories of more words are block RAM; those of as many if one block takes the width.
  constant TABLE_RAM_WORDS : positive := 128;
  constant BLOCK_BITS      : positive := 36;

  -- Whether a memory without a write port becomes block RAM.

  function block_rom (
    words : positive
  ) return boolean;

  -- Whether a memory with a write port becomes block RAM.

  function block_ram (
    words : positive;
    bits  : positive
  ) return boolean;

  -- One of two values of an attribute.

  function style (
    in_blocks : boolean;
    blocks    : string;
    tables    : string
  ) return string;

end package pe_style_pkg;

package body pe_style_pkg is

  function block_rom (
    words : positive
  ) return boolean is
  begin

    return words > TABLE_ROM_WORDS;

  end function block_rom;

  function block_ram (
    words : positive;
    bits  : positive
  ) return boolean is
  begin

    return words > TABLE_RAM_WORDS or (words = TABLE_RAM_WORDS and bits <= BLOCK_BITS);

  end function block_ram;

  function style (
    in_blocks : boolean;
    blocks    : string;
    tables    : string
  ) return string is
  begin

    if (in_blocks) then
      return blocks;
    end if;

    return tables;

  end function style;

end package body pe_style_pkg;
