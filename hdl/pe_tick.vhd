-- SPDX-License-Identifier: MIT OR Apache-2.0

library ieee;
  use ieee.std_logic_1164.all;
  use ieee.numeric_std.all;

library pe_lib;
  use pe_lib.pe_pkg.all;

-- Purpose:  The tick of a rate: counts steps; connected like an external input that is 1.0 in steps that begin with a
--           sample and 0 in all others.
-- Generics: DONE is less than STEPS; ONE_BIT lies below the sign of the operand.
-- Timing:   Loads its operand when pe_input does: one clock after sample_i, with DEEP two clocks after arrive_i.

entity pe_tick is
  generic (
    STEPS     : positive;        -- steps from one sample to the next
    DONE      : natural;         -- steps since the last sample as the network starts; 0: the first step begins with one
    ONE_BIT   : natural;         -- bit of the operand that is worth 1.0
    DATA_BITS : positive;        -- data operand
    DEEP      : boolean := false -- loads the operand when a replica says so
  );
  port (
    clk_i     : in    std_ulogic;                                                                      -- clock
    sample_i  : in    std_ulogic;                                                                      -- a step begins
    replace_i : in    std_ulogic                                                   := '0';             -- counters are replaced
    here_i    : in    std_ulogic                                                   := '0';             -- this one is
    count_i   : in    std_ulogic_vector(larger(index_bits(STEPS), 1) - 1 downto 0) := (others => '0'); -- steps since the last sample
    count_o   : out   std_ulogic_vector(larger(index_bits(STEPS), 1) - 1 downto 0);                    -- the same, as the next step begins
    operand_o : out   std_ulogic_vector(DATA_BITS - 1 downto 0);                                       -- what the ports of PEs see
    arrive_i  : in    std_ulogic                                                                       -- loads the operand a clock later, with DEEP
  );
end entity pe_tick;

architecture rtl of pe_tick is

  signal load : std_ulogic;

  signal count : natural range 0 to STEPS - 1 := DONE;
  signal tick  : std_ulogic                   := '0';

begin

  assert DONE < STEPS and ONE_BIT < DATA_BITS - 1
    report "pe_tick: DONE is less than STEPS, and 1.0 a number of the operand"
    severity failure;

  g_direct : if not DEEP generate

    load <= sample_i;

  end generate g_direct;

  g_replica : if DEEP generate

    u_arrive : entity pe_lib.pe_replica
      generic map (
        WIDTH => 1
      )
      port map (
        clk_i      => clk_i,
        value_i(0) => arrive_i,
        value_o(0) => load
      );

  end generate g_replica;

  p_count : process (clk_i) is
  begin

    if rising_edge(clk_i) then
      if (load = '1') then
        tick <= '0';

        if (count = 0) then
          tick <= '1';
        end if;

        if (count = STEPS - 1) then
          count <= 0;
        else
          count <= count + 1;
        end if;
      end if;

      if (replace_i = '1' and here_i = '1') then
        count <= to_integer(unsigned(count_i));
      end if;
    end if;

  end process p_count;

  count_o <= std_ulogic_vector(to_unsigned(count, count_o'length));

  g_operand : for i in 0 to DATA_BITS - 1 generate

    operand_o(i) <= tick when i = ONE_BIT else
                    '0';

  end generate g_operand;

end architecture rtl;
