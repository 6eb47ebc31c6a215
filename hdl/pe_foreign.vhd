-- SPDX-License-Identifier: MIT OR Apache-2.0

library ieee;
  use ieee.std_logic_1164.all;
  use ieee.numeric_std.all;

-- Purpose:  Gives an entity that runs by its clock enable the handshake of a network: one step for each step_i, of so many
--           clocks or until the entity is ready.
-- Timing:   A step begins in an enabled clock with busy_o = 0 and step_i = 1, at whose end the entity's inputs are taken. It
--           is enabled in the following clocks_i clocks, the first of which has start_o = 1; its outputs are read in the
--           clock after them. With clocks_i = 0 it is enabled until a clock, not the first one, that has ready_i = 1, in
--           which its outputs are read. Either way done_o is 1 in the clock after the last enabled one, and another step
--           may begin there. Between two steps the entity stands still. ready_i may depend on all that the entity sees.
--           A reset holds reset_o and the clock enable for RESET_CLOCKS clocks, and ends a step; so does configuration.

entity pe_foreign is
  generic (
    RESET_CLOCKS : natural -- clocks of a reset; 0 if the entity has none
  );
  port (
    clk_i    : in    std_ulogic;                     -- clock
    ce_i     : in    std_ulogic;                     -- clock enable
    step_i   : in    std_ulogic;                     -- lets a step begin
    reset_i  : in    std_ulogic;                     -- resets the entity
    clocks_i : in    std_ulogic_vector(31 downto 0); -- clocks of a step; 0 until the entity is ready
    ready_i  : in    std_ulogic;                     -- the entity has ended its step
    busy_o   : out   std_ulogic;                     -- no step can begin
    done_o   : out   std_ulogic;                     -- outputs are new
    take_o   : out   std_ulogic;                     -- the step begins: inputs are taken at the end of the clock
    show_o   : out   std_ulogic;                     -- the entity shows the outputs of the step
    enable_o : out   std_ulogic;                     -- clock enable of the entity
    start_o  : out   std_ulogic;                     -- the first clock of a step
    reset_o  : out   std_ulogic                      -- reset of the entity
  );
end entity pe_foreign;

architecture rtl of pe_foreign is

  -- Whether there is a reset.

  function reset_level return std_ulogic is
  begin

    if (RESET_CLOCKS > 0) then
      return '1';
    end if;

    return '0';

  end function reset_level;

  constant RESETS : std_ulogic := reset_level;

  signal stepping  : std_ulogic                                  := '0';
  signal first     : std_ulogic                                  := '0';
  signal waits     : std_ulogic                                  := '0'; -- for the entity to be ready
  signal left      : unsigned(31 downto 0)                       := (others => '0');
  signal done      : std_ulogic                                  := '0';
  signal resetting : std_ulogic                                  := RESETS;
  signal reset_for : natural range 0 to maximum(RESET_CLOCKS, 1) := RESET_CLOCKS;

  signal busy   : std_ulogic;
  signal begins : std_ulogic;
  signal ends   : std_ulogic;

begin

  busy   <= stepping or resetting;
  begins <= ce_i and step_i and not busy and not reset_i;

  ends <= ce_i and stepping and ready_i and not first when waits = '1' else
          ce_i and stepping when left = 1 else
          '0';

  p_step : process (clk_i) is
  begin

    if rising_edge(clk_i) then
      if (ce_i = '1') then
        done  <= ends;
        first <= begins;

        if (stepping = '1') then
          left     <= left - 1;
          stepping <= not ends;
        end if;

        if (begins = '1') then
          stepping <= '1';
          left     <= unsigned(clocks_i);
          waits    <= nor clocks_i;
        end if;

        if (resetting = '1') then
          reset_for <= reset_for - 1;

          if (reset_for = 1) then
            resetting <= '0';
          end if;
        end if;
      end if;

      if (reset_i = '1') then
        stepping  <= '0';
        done      <= '0';
        resetting <= RESETS;
        reset_for <= RESET_CLOCKS;
      end if;
    end if;

  end process p_step;

  busy_o   <= busy;
  done_o   <= done;
  take_o   <= begins;
  show_o   <= ends when waits = '1' else
              done;
  enable_o <= ce_i and busy;
  start_o  <= first;
  reset_o  <= resetting;

end architecture rtl;
