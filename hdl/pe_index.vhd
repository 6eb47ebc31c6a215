-- SPDX-License-Identifier: MIT OR Apache-2.0

library ieee;
  use ieee.std_logic_1164.all;

library pe_lib;
  use pe_lib.pe_pkg.all;
  use pe_lib.pe_write_pkg.all;

-- Purpose:  Index memory of a PE with function tables: stores the segment of a written word, and returns the index that
--           is joined with the base address of the next control word, 0 if none is enabled.
-- Generics: WORDS is a power of two; an index has at most the WORD_BITS of a word, and more bits than count octaves.
-- Timing:   As pe_ram: an index is valid one clock after its address; all registers hold without ce_i.

entity pe_index is
  generic (
    WORDS        : positive; -- depth, a power of two
    WORD_BITS    : positive; -- written word
    INDEX_WIDTH  : positive; -- bits of an index
    OCTAVE_WIDTH : natural   -- bits of an index that count octaves, 0 if none do
  );
  port (
    clk_i           : in    std_ulogic;                                        -- clock
    ce_i            : in    std_ulogic;                                        -- clock enable
    write_enable_i  : in    std_ulogic;                                        -- takes the segment of word_i
    octave_i        : in    std_ulogic;                                        -- the segment counts octaves
    write_address_i : in    std_ulogic_vector(index_bits(WORDS) - 1 downto 0); -- index to write
    word_i          : in    std_ulogic_vector(WORD_BITS - 1 downto 0);         -- word of the write group
    read_enable_i   : in    std_ulogic;                                        -- 0 loads 0
    read_address_i  : in    std_ulogic_vector(index_bits(WORDS) - 1 downto 0); -- index to read
    index_o         : out   std_ulogic_vector(INDEX_WIDTH - 1 downto 0)        -- read register
  );
end entity pe_index;

architecture rtl of pe_index is

  constant IMAGE : word_array_t(0 to WORDS - 1)(INDEX_WIDTH - 1 downto 0) := (others => (others => '0'));

  signal segment : std_ulogic_vector(INDEX_WIDTH - 1 downto 0);

begin

  assert INDEX_WIDTH <= WORD_BITS and OCTAVE_WIDTH < INDEX_WIDTH
    report "pe_index: an index has at most the bits of a word, and more than count octaves"
    severity failure;

  g_octaves : if OCTAVE_WIDTH > 0 generate

    segment <= octave_segment(word_i, INDEX_WIDTH, OCTAVE_WIDTH) when octave_i = '1' else
               equal_segment(word_i, INDEX_WIDTH);

  end generate g_octaves;

  g_equal : if OCTAVE_WIDTH = 0 generate

    segment <= equal_segment(word_i, INDEX_WIDTH);

  end generate g_equal;

  u_memory : entity pe_lib.pe_ram
    generic map (
      WORDS     => WORDS,
      WORD_BITS => INDEX_WIDTH,
      IMAGE     => IMAGE
    )
    port map (
      clk_i           => clk_i,
      ce_i            => ce_i,
      write_enable_i  => write_enable_i,
      write_address_i => write_address_i,
      write_data_i    => segment,
      read_enable_i   => read_enable_i,
      read_address_i  => read_address_i,
      default_i       => (others => '0'),
      read_data_o     => index_o
    );

end architecture rtl;
