-- SPDX-License-Identifier: MIT OR Apache-2.0

library ieee;
  use ieee.std_logic_1164.all;
  use ieee.numeric_std.all;

library pe_lib;
  use pe_lib.pe_pkg.all;

-- Purpose:  The operand of a PE on the coefficient port of the multiplier: from a memory that the PE writes, from a
--           memory that nothing writes, or from the control word.
-- Generics: COEFF_WORDS is 0, where the control word has the coefficient, or a power of two; FACTOR needs a memory.
-- Timing:   docs/hardware.md, "Timing", operand group: the operand is valid one clock after its control word, two with
--           DEEP. All registers hold in clocks without advance_i.

entity pe_coefficient is
  generic (
    WORD_BITS        : positive;     -- stored word, guard bits included
    COEFFICIENT_BITS : positive;     -- coefficient port of the multiplier
    CONTROL_BITS     : positive;     -- control word
    LAYOUT           : layout_t;     -- its fields
    COEFF_WORDS      : natural;      -- coefficient memory, 0 or a power of two
    WRITE_BITS       : positive;     -- write address
    FACTOR           : boolean;      -- the memory is written
    COEFF_IMAGE      : word_array_t; -- initial coefficient memory
    DEEP             : boolean       -- a second register
  );
  port (
    clk_i           : in    std_ulogic;                                      -- clock
    advance_i       : in    std_ulogic;                                      -- executes the control word
    control_i       : in    std_ulogic_vector(CONTROL_BITS - 1 downto 0);    -- control register
    write_i         : in    std_ulogic;                                      -- the memory takes a factor
    write_address_i : in    std_ulogic_vector(WRITE_BITS - 1 downto 0);      -- word to write
    word_i          : in    std_ulogic_vector(WORD_BITS - 1 downto 0);       -- word of the write group
    coefficient_o   : out   std_ulogic_vector(COEFFICIENT_BITS - 1 downto 0) -- operand
  );
end entity pe_coefficient;

architecture rtl of pe_coefficient is

begin

  g_stored : if COEFF_WORDS > 0 generate

    constant COEFF_BITS : positive := larger(index_bits(COEFF_WORDS), 1);

  begin

    g_written : if FACTOR generate

      u_coefficient : entity pe_lib.pe_ram
        generic map (
          WORDS     => COEFF_WORDS,
          WORD_BITS => COEFFICIENT_BITS,
          IMAGE     => COEFF_IMAGE,
          DEEP      => DEEP
        )
        port map (
          clk_i           => clk_i,
          ce_i            => advance_i,
          write_enable_i  => write_i,
          write_address_i => std_ulogic_vector(resize(unsigned(write_address_i), COEFF_BITS)),
          write_data_i    => word_i(WORD_BITS - 1 downto WORD_BITS - COEFFICIENT_BITS),
          read_enable_i   => '1',
          read_address_i  => bits(control_i, LAYOUT.coefficient_address, COEFF_BITS),
          default_i       => (others => '0'),
          read_data_o     => coefficient_o
        );

    end generate g_written;

    g_constant : if not FACTOR generate

      signal coefficient : std_ulogic_vector(COEFFICIENT_BITS - 1 downto 0);
      signal follower    : std_ulogic_vector(COEFFICIENT_BITS - 1 downto 0) := (others => '0');

    begin

      u_coefficient : entity pe_lib.pe_rom
        generic map (
          CONTROL_BITS => COEFFICIENT_BITS,
          PERIOD       => COEFF_WORDS,
          CONTENT      => COEFF_IMAGE
        )
        port map (
          clk_i     => clk_i,
          fetch_i   => advance_i,
          address_i => bits(control_i, LAYOUT.coefficient_address, COEFF_BITS),
          control_o => coefficient
        );

      p_follow : process (clk_i) is
      begin

        if rising_edge(clk_i) then
          if (advance_i = '1') then
            follower <= coefficient;
          end if;
        end if;

      end process p_follow;

      coefficient_o <= follower when DEEP else
                       coefficient;

    end generate g_constant;

  end generate g_stored;

  g_in_word : if COEFF_WORDS = 0 generate

    signal coefficient : std_ulogic_vector(COEFFICIENT_BITS - 1 downto 0) := (others => '0');
    signal follower    : std_ulogic_vector(COEFFICIENT_BITS - 1 downto 0) := (others => '0');

  begin

    p_coefficient : process (clk_i) is
    begin

      if rising_edge(clk_i) then
        if (advance_i = '1') then
          coefficient <= bits(control_i, LAYOUT.coefficient, COEFFICIENT_BITS);
          follower    <= coefficient;
        end if;
      end if;

    end process p_coefficient;

    coefficient_o <= follower when DEEP else
                     coefficient;

  end generate g_in_word;

end architecture rtl;
