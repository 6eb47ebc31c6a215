-- SPDX-License-Identifier: MIT OR Apache-2.0

library ieee;
  use ieee.std_logic_1164.all;
  use ieee.numeric_std.all;

library pe_lib;
  use pe_lib.pe_pkg.all;

-- Purpose:  Keeps the words of a PE that outputs show: those of the last published step, and in another bank those of the
--           step that runs. Words get places in the order in which they are written.
-- Generics: WORDS is a power of two from 2 on. SHOWN_BITS are the upper bits of a stored word that outputs depend on.
-- Timing:   Writes in clocks with write_i. With publish_i the banks exchange roles at the end of the clock, so that a word
--           read in a clock is of the step that was published before it; it is at word_o a clock after its place. What is
--           written in the first pass goes to the first place, and is written again in the step. With DEEP settle_i and
--           publish_i come one clock before the word.

entity pe_output_memory is
  generic (
    WORDS      : positive;        -- words of a bank
    SHOWN_BITS : positive;        -- width of a word
    DATA_BITS  : positive;        -- data operand: tells the rounding offset
    DEEP       : boolean := false -- registers of its own of what it is told
  );
  port (
    clk_i     : in    std_ulogic;                                        -- clock
    write_i   : in    std_ulogic;                                        -- takes a word
    word_i    : in    std_ulogic_vector(SHOWN_BITS - 1 downto 0);        -- word of the PE's write group
    settle_i  : in    std_ulogic;                                        -- first pass
    publish_i : in    std_ulogic;                                        -- the step is done
    here_i    : in    std_ulogic;                                        -- a word of this PE is read
    place_i   : in    std_ulogic_vector(index_bits(WORDS) - 1 downto 0); -- its place
    word_o    : out   std_ulogic_vector(SHOWN_BITS - 1 downto 0)         -- the word, or 0
  );
end entity pe_output_memory;

architecture rtl of pe_output_memory is

  -- All outputs are 0 before the first step, so words are the rounding offset, as far as it is among their bits.

  function initial return word_array_t is

    variable image : word_array_t(0 to 2 * WORDS - 1)(SHOWN_BITS - 1 downto 0);

  begin

    image := (others => (others => '0'));

    if (SHOWN_BITS > DATA_BITS) then

      for i in image'range loop

        image(i)(SHOWN_BITS - DATA_BITS - 1) := '1';

      end loop;

    end if;

    return image;

  end function initial;

  signal settle        : std_ulogic;
  signal publish       : std_ulogic;
  signal published     : std_ulogic                               := '0';
  signal place         : unsigned(index_bits(WORDS) - 1 downto 0) := (others => '0');
  signal write_address : std_ulogic_vector(index_bits(WORDS) downto 0);
  signal read_address  : std_ulogic_vector(index_bits(WORDS) downto 0);

begin

  assert WORDS > 1 and 2 ** index_bits(WORDS) = WORDS
    report "pe_output_memory: WORDS is a power of two from 2 on"
    severity failure;

  g_direct : if not DEEP generate

    settle  <= settle_i;
    publish <= publish_i;

  end generate g_direct;

  g_replicated : if DEEP generate

    u_told : entity pe_lib.pe_replica
      generic map (
        WIDTH => 2
      )
      port map (
        clk_i      => clk_i,
        value_i(1) => settle_i,
        value_i(0) => publish_i,
        value_o(1) => settle,
        value_o(0) => publish
      );

  end generate g_replicated;

  p_place : process (clk_i) is
  begin

    if rising_edge(clk_i) then
      if (write_i = '1') then
        place <= place + 1;
      end if;

      if (publish = '1' or settle = '1') then
        place <= (others => '0');
      end if;

      published <= published xor publish;
    end if;

  end process p_place;

  write_address <= not published & std_ulogic_vector(place);
  read_address  <= published & place_i;

  u_memory : entity pe_lib.pe_ram
    generic map (
      WORDS     => 2 * WORDS,
      WORD_BITS => SHOWN_BITS,
      IMAGE     => initial
    )
    port map (
      clk_i           => clk_i,
      ce_i            => '1',
      write_enable_i  => write_i,
      write_address_i => write_address,
      write_data_i    => word_i,
      read_enable_i   => here_i,
      read_address_i  => read_address,
      default_i       => (others => '0'),
      read_data_o     => word_o
    );

end architecture rtl;
