-- SPDX-License-Identifier: MIT OR Apache-2.0

library ieee;
  use ieee.std_logic_1164.all;
  use ieee.numeric_std.all;

library pe_lib;
  use pe_lib.pe_pkg.all;
  use pe_lib.pe_style_pkg.all;

-- Purpose:  Program ROM of one PE, whose registered output is the control register, or ROM of its coefficients.
-- Generics: CONTENT has PERIOD elements of CONTROL_BITS; any number of words is allowed.
-- Timing:   A word is at control_o one clock after its address, and is held without fetch_i. With DEEP it arrives four
--           clocks after the address: through a replica of the address and, behind the memory, the output register of
--           the block RAM and one that synthesis may place beside the PE. They never hold.

entity pe_rom is
  generic (
    CONTROL_BITS : positive;         -- width of a control word
    PERIOD       : positive;         -- number of control words
    CONTENT      : word_array_t;     -- the control words
    DEEP         : boolean := false; -- three more registers
    TABLES       : boolean := false  -- look-up tables at any depth
  );
  port (
    clk_i     : in    std_ulogic;                                                    -- clock
    fetch_i   : in    std_ulogic;                                                    -- reads the memory
    address_i : in    std_ulogic_vector(larger(index_bits(PERIOD), 1) - 1 downto 0); -- control word to load
    control_o : out   std_ulogic_vector(CONTROL_BITS - 1 downto 0);                  -- control register
    clear_i   : in    std_ulogic := '0'                                              -- makes it what it was at first
  );
end entity pe_rom;

architecture rtl of pe_rom is

  constant DEPTH     : positive := 2 ** larger(index_bits(PERIOD), 1);
  constant IN_BLOCKS : boolean  := block_rom(PERIOD) and not TABLES;

  type rom_t is array (DEPTH - 1 downto 0) of std_ulogic_vector(CONTROL_BITS - 1 downto 0);

  function filled return rom_t is

    variable rom : rom_t;

  begin

    rom := (others => (others => '0'));

    for i in 0 to PERIOD - 1 loop

      rom(i) := CONTENT(i);

    end loop;

    return rom;

  end function filled;

  constant ROM : rom_t := filled;

  signal address : std_ulogic_vector(address_i'range);

  -- What the first word takes from the word before it must be known.
  signal fetched : std_ulogic_vector(CONTROL_BITS - 1 downto 0) := (others => '0');

  -- Some tools look at the memory, others at what it is read into.
  attribute rom_style of ROM        : constant is style(IN_BLOCKS, "block", "distributed");
  attribute rom_style of fetched    : signal is style(IN_BLOCKS, "block", "distributed");
  attribute romstyle of ROM         : constant is style(IN_BLOCKS, "M20K", "logic");
  attribute romstyle of fetched     : signal is style(IN_BLOCKS, "M20K", "logic");
  attribute syn_romstyle of ROM     : constant is style(IN_BLOCKS, "block_rom", "logic");
  attribute syn_romstyle of fetched : signal is style(IN_BLOCKS, "block_rom", "logic");

begin

  assert CONTENT'length = PERIOD
    report "pe_rom: CONTENT has PERIOD elements"
    severity failure;

  p_fetch : process (clk_i) is
  begin

    if rising_edge(clk_i) then
      if (fetch_i = '1') then
        fetched <= ROM(to_integer(unsigned(address)));
      end if;

      if (clear_i = '1') then
        fetched <= (others => '0');
      end if;
    end if;

  end process p_fetch;

  g_direct : if not DEEP generate

    address   <= address_i;
    control_o <= fetched;

  end generate g_direct;

  g_followed : if DEEP generate

    signal follower : std_ulogic_vector(CONTROL_BITS - 1 downto 0);

  begin

    u_address : entity pe_lib.pe_replica
      generic map (
        WIDTH => address_i'length
      )
      port map (
        clk_i   => clk_i,
        value_i => address_i,
        value_o => address
      );

    p_load : process (clk_i) is
    begin

      if rising_edge(clk_i) then
        follower  <= fetched;
        control_o <= follower;
      end if;

    end process p_load;

  end generate g_followed;

end architecture rtl;
