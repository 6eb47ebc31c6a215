-- SPDX-License-Identifier: MIT OR Apache-2.0

library ieee;
  use ieee.std_logic_1164.all;
  use ieee.numeric_std.all;

library pe_lib;
  use pe_lib.pe_pkg.all;
  use pe_lib.pe_style_pkg.all;

-- Purpose:  Memory with one write port and one registered read port. May be replaced by a vendor's memory of the same
--           behaviour.
-- Generics: WORDS is a power of two, IMAGE has WORDS elements of WORD_BITS.
-- Timing:   A word is valid one clock after its address, two with DEEP; all registers hold without ce_i. A disabled
--           read loads `default_i` instead; where that is a constant, the read register's synchronous set and reset do
--           it. A word that is read and written in the same clock reads as before the write.

entity pe_ram is
  generic (
    WORDS     : positive;        -- depth, a power of two
    WORD_BITS : positive;        -- width of a word
    IMAGE     : word_array_t;    -- initial content
    DEEP      : boolean := false -- a second register
  );
  port (
    clk_i           : in    std_ulogic;                                        -- clock
    ce_i            : in    std_ulogic;                                        -- clock enable
    write_enable_i  : in    std_ulogic;                                        -- write, only with ce_i
    write_address_i : in    std_ulogic_vector(index_bits(WORDS) - 1 downto 0); -- word to write
    write_data_i    : in    std_ulogic_vector(WORD_BITS - 1 downto 0);         -- new content
    read_enable_i   : in    std_ulogic;                                        -- 0 loads default_i
    read_address_i  : in    std_ulogic_vector(index_bits(WORDS) - 1 downto 0); -- word to read
    default_i       : in    std_ulogic_vector(WORD_BITS - 1 downto 0);         -- value of a disabled read
    read_data_o     : out   std_ulogic_vector(WORD_BITS - 1 downto 0)          -- read register
  );
end entity pe_ram;

architecture rtl of pe_ram is

  -- GHDL 2.0 synthesises an initial content of exactly 64 bits as 0 if its lower half is 0; words that no address
  -- reaches avoid that.

  function depth return positive is
  begin

    if (WORDS * WORD_BITS = 64) then
      return 2 * WORDS;
    end if;

    return WORDS;

  end function depth;

  constant IN_BLOCKS : boolean := block_ram(WORDS, WORD_BITS);

  type memory_t is array (depth - 1 downto 0) of std_ulogic_vector(WORD_BITS - 1 downto 0);

  function initial_memory return memory_t is

    variable memory : memory_t := (others => (others => '0'));

  begin

    for i in 0 to WORDS - 1 loop

      memory(i) := IMAGE(i);

    end loop;

    return memory;

  end function initial_memory;

  signal read_data : std_ulogic_vector(WORD_BITS - 1 downto 0) := (others => '0');

begin

  assert 2 ** index_bits(WORDS) = WORDS and IMAGE'length = WORDS
    report "pe_ram: WORDS is a power of two, and IMAGE has as many elements"
    severity failure;

  -- The memory is a variable: as a signal it would cost a simulator far more time and space.
  p_memory : process (clk_i) is

    variable memory : memory_t := initial_memory;

    -- No word is read in the clock that writes it, so nothing need be made for that.
    attribute ram_style of memory    : variable is style(IN_BLOCKS, "block", "distributed");
    attribute ramstyle of memory     : variable is style(IN_BLOCKS, "no_rw_check", "MLAB, no_rw_check");
    attribute syn_ramstyle of memory : variable is style(IN_BLOCKS, "block_ram, no_rw_check", "no_rw_check");

  begin

    if rising_edge(clk_i) then
      if (ce_i = '1') then
        if (read_enable_i = '1' or DEEP) then
          read_data <= memory(to_integer(unsigned(read_address_i)));
        else
          read_data <= default_i;
        end if;

        if (write_enable_i = '1') then
          memory(to_integer(unsigned(write_address_i))) := write_data_i;
        end if;
      end if;
    end if;

  end process p_memory;

  g_direct : if not DEEP generate

    read_data_o <= read_data;

  end generate g_direct;

  g_second : if DEEP generate

    signal enabled : std_ulogic                                := '0';
    signal loaded  : std_ulogic                                := '1';
    signal second  : std_ulogic_vector(WORD_BITS - 1 downto 0) := (others => '0');

  begin

    p_second : process (clk_i) is
    begin

      if rising_edge(clk_i) then
        if (ce_i = '1') then
          enabled <= read_enable_i;

          loaded <= enabled;

          if (enabled = '1') then
            second <= read_data;
          else
            second <= (others => '0');
          end if;
        end if;
      end if;

    end process p_second;

    -- The register's reset takes no logic, only bits that are 1 then take some.
    read_data_o <= second when loaded = '1' else
                   second or default_i;

  end generate g_second;

end architecture rtl;
